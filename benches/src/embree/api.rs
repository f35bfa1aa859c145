//! The C interface: functions and structures, and a device that is released when dropped.
#![expect(unsafe_code, reason = "functions of a C library")]

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::sync::{Arc, Mutex, PoisonError};
use std::{mem, ptr};

use bytemuck::Zeroable;
use libloading::Library;

use super::not_found::NotFound;
use crate::Failure;

pub(super) const SCENE_DYNAMIC: c_int = 1;
pub(super) const SCENE_ROBUST: c_int = 4;
pub(super) const GEOMETRY_TRIANGLE: c_int = 0;
pub(super) const BUFFER_INDEX: c_int = 0;
pub(super) const BUFFER_VERTEX: c_int = 1;
pub(super) const FORMAT_UINT3: c_int = 0x5003;
pub(super) const FORMAT_FLOAT3: c_int = 0x9003;
/// In place of a geometry's number: nothing was hit.
pub(super) const INVALID_ID: u32 = u32::MAX;

const PROPERTY_VERSION: c_int = 0;

pub(super) type Handle = *mut c_void;
type ErrorFunction = extern "C" fn(user: *mut c_void, code: c_int, message: *const c_char);
/// Version 4: ray, arguments. Version 3: context, ray.
pub(super) type Query1 = unsafe extern "C" fn(Handle, *mut c_void, *mut c_void);
/// The same with a mask of active rays before them.
pub(super) type QueryN = unsafe extern "C" fn(*const i32, Handle, *mut c_void, *mut c_void);

/// Declares the functions, and how they are looked up by name.
macro_rules! functions {
    ($($(#[$doc:meta])* $field:ident = $name:literal: $type:ty;)*) => {
        /// Functions of the library, which is never unloaded: threads of its TBB go on running its
        /// code after the last device is released.
        pub(super) struct Api {
            $($(#[$doc])* pub(super) $field: $type,)*
        }

        impl Api {
            /// Looks all functions up.
            pub(super) fn new(library: Library) -> Result<Self, libloading::Error> {
                // SAFETY: the names are those of Embree's functions, with types written from its
                // headers. The pointers stay valid, since the library is forgotten and so never
                // unloaded.
                let api = unsafe { Self { $($field: *library.get::<$type>($name.as_bytes())?,)* } };
                mem::forget(library);
                Ok(api)
            }
        }
    };
}

functions! {
    new_device = "rtcNewDevice": unsafe extern "C" fn(*const c_char) -> Handle;
    release_device = "rtcReleaseDevice": unsafe extern "C" fn(Handle);
    device_error = "rtcGetDeviceError": unsafe extern "C" fn(Handle) -> c_int;
    set_error_function = "rtcSetDeviceErrorFunction":
        unsafe extern "C" fn(Handle, Option<ErrorFunction>, *mut c_void);
    device_property = "rtcGetDeviceProperty": unsafe extern "C" fn(Handle, c_int) -> isize;
    new_scene = "rtcNewScene": unsafe extern "C" fn(Handle) -> Handle;
    release_scene = "rtcReleaseScene": unsafe extern "C" fn(Handle);
    set_scene_flags = "rtcSetSceneFlags": unsafe extern "C" fn(Handle, c_int);
    set_scene_quality = "rtcSetSceneBuildQuality": unsafe extern "C" fn(Handle, c_int);
    attach_geometry = "rtcAttachGeometry": unsafe extern "C" fn(Handle, Handle) -> u32;
    commit_scene = "rtcCommitScene": unsafe extern "C" fn(Handle);
    new_geometry = "rtcNewGeometry": unsafe extern "C" fn(Handle, c_int) -> Handle;
    release_geometry = "rtcReleaseGeometry": unsafe extern "C" fn(Handle);
    set_geometry_quality = "rtcSetGeometryBuildQuality": unsafe extern "C" fn(Handle, c_int);
    /// Geometry, kind, slot, format, memory, offset, stride, number of items.
    set_shared_buffer = "rtcSetSharedGeometryBuffer":
        unsafe extern "C" fn(Handle, c_int, u32, c_int, *const c_void, usize, usize, usize);
    update_buffer = "rtcUpdateGeometryBuffer": unsafe extern "C" fn(Handle, c_int, u32);
    commit_geometry = "rtcCommitGeometry": unsafe extern "C" fn(Handle);
    intersect1 = "rtcIntersect1": Query1;
    intersect8 = "rtcIntersect8": QueryN;
    intersect16 = "rtcIntersect16": QueryN;
    occluded1 = "rtcOccluded1": Query1;
    occluded8 = "rtcOccluded8": QueryN;
    occluded16 = "rtcOccluded16": QueryN;
}

/// `RTCRayN` and behind it `RTCHitN`, for packets of any size, and at N = 1 also `RTCRayHit`.
///
/// The last field is there in libraries built with instance arrays, and unused in others.
#[repr(C, align(64))]
#[derive(Zeroable)]
pub(super) struct RayHit<const N: usize> {
    pub(super) origin: [[f32; N]; 3],
    pub(super) t_near: [f32; N],
    pub(super) direction: [[f32; N]; 3],
    pub(super) time: [f32; N],
    pub(super) t_far: [f32; N],
    pub(super) mask: [u32; N],
    pub(super) id: [u32; N],
    pub(super) flags: [u32; N],
    pub(super) normal: [[f32; N]; 3],
    pub(super) u: [f32; N],
    pub(super) v: [f32; N],
    pub(super) primitive: [u32; N],
    pub(super) geometry: [u32; N],
    pub(super) instance: [u32; N],
    pub(super) instance_primitive: [u32; N],
}

/// Version 4: `RTCIntersectArguments` and `RTCOccludedArguments`.
#[repr(C)]
#[derive(Zeroable)]
pub(super) struct Arguments {
    flags: u32,
    features: u32,
    context: *mut c_void,
    filter: *mut c_void,
    callback: *mut c_void,
    min_width: f32,
}

/// Version 3: `RTCIntersectContext`.
#[repr(C)]
#[derive(Zeroable)]
pub(super) struct Context {
    flags: u32,
    filter: *mut c_void,
    instance: u32,
    min_width: f32,
}

/// What goes with a query, as the version wants it.
pub(super) enum Extra {
    V3(Context),
    V4(Arguments),
}

impl Extra {
    /// For rays that go much the same way, or for any.
    pub(super) fn new(version: isize, coherent: bool) -> Self {
        let flags = u32::from(coherent);
        if version < 40_000 {
            Self::V3(Context { flags, instance: INVALID_ID, ..Context::zeroed() })
        } else {
            Self::V4(Arguments { flags: flags << 16, features: u32::MAX, ..Arguments::zeroed() })
        }
    }

    /// The last two parameters of a query for `rays`, in the order of the version.
    pub(super) fn with<T>(&mut self, rays: &mut T) -> (*mut c_void, *mut c_void) {
        let rays = ptr::from_mut(rays).cast();
        match self {
            Self::V3(context) => (ptr::from_mut(context).cast(), rays),
            Self::V4(arguments) => (rays, ptr::from_mut(arguments).cast()),
        }
    }
}

/// A device, and the last error that Embree reported for it.
pub(super) struct DeviceHandle {
    pub(super) api: Arc<Api>,
    pub(super) handle: Handle,
    /// As major * 10000 + minor * 100 + patch.
    pub(super) version: isize,
    error: Box<Mutex<Option<String>>>,
}

// SAFETY: Embree's devices may be used from any thread, and from several at once.
unsafe impl Send for DeviceHandle {}
// SAFETY: as above.
unsafe impl Sync for DeviceHandle {}

extern "C" fn report(user: *mut c_void, code: c_int, message: *const c_char) {
    // SAFETY: `user` is what was given along with this function: the device's mutex, which outlives
    // the device. `message` is null or a C string.
    let (error, message) = unsafe {
        let message = (!message.is_null()).then(|| CStr::from_ptr(message).to_string_lossy().into_owned());
        (&*user.cast::<Mutex<Option<String>>>(), message.unwrap_or_default())
    };
    *error.lock().unwrap_or_else(PoisonError::into_inner) = Some(format!("error {code}: {message}"));
}

impl DeviceHandle {
    /// A device that uses no more of the processor than `isa`, if anything is said.
    pub(super) fn new(api: &Arc<Api>, threads: usize, isa: Option<&str>) -> Result<Self, NotFound> {
        let isa = isa.map(|isa| format!(",max_isa={isa}")).unwrap_or_default();
        let config = CString::new(format!("threads={threads},start_threads=0,set_affinity=0{isa}"))
            .map_err(|_| NotFound::Device(0))?;
        let mut error = Box::new(Mutex::new(None));
        // SAFETY: `config` is a C string. The mutex lies in a box that is dropped after the device
        // is released.
        unsafe {
            let handle = (api.new_device)(config.as_ptr());
            if handle.is_null() {
                return Err(NotFound::Device((api.device_error)(ptr::null_mut())));
            }
            (api.set_error_function)(handle, Some(report), ptr::from_mut(error.as_mut()).cast());
            let version = (api.device_property)(handle, PROPERTY_VERSION);
            Ok(Self { api: Arc::clone(api), handle, version, error })
        }
    }

    /// The error that was reported since the last time, if any.
    pub(super) fn check(&self) -> Result<(), Failure> {
        match self.error.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(what) => Err(Failure { who: "embree", what }),
            None => Ok(()),
        }
    }
}

impl Drop for DeviceHandle {
    fn drop(&mut self) {
        // SAFETY: the handle came from `new_device` and is released once.
        unsafe { (self.api.release_device)(self.handle) }
    }
}

#[cfg(test)]
mod tests {
    use std::mem::offset_of;

    use super::*;

    #[test]
    fn structures_are_laid_out_as_in_the_headers() {
        // RTCRay has 48 bytes, RTCHit follows; packets have 12 arrays of the ray first.
        assert_eq!(offset_of!(RayHit<1>, t_far), 32);
        assert_eq!(offset_of!(RayHit<1>, normal), 48);
        assert_eq!(offset_of!(RayHit<1>, geometry), 72);
        assert_eq!(offset_of!(RayHit<8>, normal), 12 * 32);
        assert_eq!(offset_of!(RayHit<16>, normal), 12 * 64);
        assert_eq!(offset_of!(RayHit<16>, geometry), 18 * 64);
        #[cfg(target_pointer_width = "64")]
        {
            assert_eq!(offset_of!(Arguments, context), 8);
            assert_eq!(offset_of!(Arguments, min_width), 32);
            assert_eq!(offset_of!(Context, filter), 8);
            assert_eq!(offset_of!(Context, instance), 16);
        }
    }
}
