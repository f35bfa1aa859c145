//! Images of any shape show the sides of the view.

use anim::View;
use bvh_core::Vec3;
use stage::camera;

#[test]
fn narrow_images_show_as_much_from_side_to_side() {
    let view = View { eye: Vec3::ZERO, target: Vec3::NEG_Z, up: Vec3::Y, fov_y: 0.7 };
    // Half of the extent across the view, and upwards, at distance 1.
    let half = |width, height| {
        let corner = camera(view, width, height).ray(0, 0).direction();
        let within = |pixels: u32| 1.0 - 1.0 / pixels as f32;
        [-corner.x / within(width), corner.y / within(height)]
    };
    let [across, upwards] = half(800, 900);
    for (width, height) in [(400, 900), (100, 900), (2, 4000)] {
        let [x, y] = half(width, height);
        assert!((x / across - 1.0).abs() < 1e-3, "{width} x {height}: {x} for {across}");
        assert!((y / x / height as f32 * width as f32 - 1.0).abs() < 1e-3);
    }
    for width in [800, 900, 5000] {
        assert!((half(width, 900)[1] / upwards - 1.0).abs() < 1e-3, "{width}");
    }
}
