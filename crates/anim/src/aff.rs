//! AFF, the text format of BART, for those who have its scenes.

mod geometry;
mod reader;
#[cfg(test)]
mod tests;
mod tokens;
mod track;

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use glam::{Affine3A, DAffine3, DVec3, Vec3};

use self::geometry::{Frame, Patch, Source};
use self::reader::{AffLight, Camera, Scene};
use self::track::Track;
use crate::error::{LoadError, Problem};
use crate::{Animation, Light, Model, Motion, PoseStats, Topology, View};

/// A scene of BART; from [`load`].
///
/// Time 0 is the start that the file gives. What stands still is placed once; a pose moves the
/// parts under animated transforms, and blends the triangles that have keys of their own linearly.
/// A pose takes time linear in the numbers of transforms, of parts and of vertices that move.
pub(crate) struct AffAnimation {
    model: Model,
    /// One for each part, empty for those that stand still.
    sources: Vec<Source>,
    /// The animated transforms that do move.
    nodes: Vec<(Arc<Track>, Frame)>,
    start: f64,
    /// What is subtracted from the coordinates of the file.
    origin: DVec3,
    camera: Option<Camera>,
    /// The track of the camera, without keys if it stands still.
    camera_track: Arc<Track>,
    light: Option<AffLight>,
    /// The track of the light itself, without keys if it stands still.
    light_track: Arc<Track>,
}

/// Loads the scene that `file` names, relative to `origin`.
pub(crate) fn load(file: &Path, origin: DVec3) -> Result<AffAnimation, LoadError> {
    let Scene { mut topology, mut sources, nodes: transforms, mut tracks, camera, light, time, disordered } =
        reader::read(file, origin)?;
    if topology.triangles.is_empty() {
        return Err(Problem::new("whole scene", "no triangles", "at least one").in_file(file));
    }
    tracks.retain(|_, track| !track.is_identity());
    // Transforms that do not move are folded into what is under them.
    let (mut nodes, mut places) = (Vec::new(), Vec::new());
    for (track, frame) in transforms {
        let frame = place(&places, frame);
        places.push(match tracks.get(&track) {
            None => frame,
            Some(track) => {
                nodes.push((Arc::clone(track), frame));
                Frame { node: Some(nodes.len() as u32 - 1), ..Frame::default() }
            }
        });
    }
    let light = light.map(|light| AffLight { frame: place(&places, light.frame), ..light });
    let light_track = light.as_ref().and_then(|light| tracks.get(light.track.as_ref()?).cloned());
    let light_track = light_track.unwrap_or_default();
    let camera_track = tracks.remove("camera").unwrap_or_default();
    let mut rest = place_parts(&mut topology, &mut sources, &places);

    // From start to end as the file says, or else as long as anything has keys.
    let tracks = || nodes.iter().map(|(track, _)| track).chain([&camera_track, &light_track]);
    let patches = sources.iter().flat_map(|part| &part.patches);
    let spans = patches.map(Patch::span).chain(tracks().flat_map(|track| track.spans()));
    let keys = spans.reduce(|(a, b), (start, end)| (a.min(start), b.max(end)));
    let (start, end) = time.map(|(start, end, _)| (start, end)).or(keys).unwrap_or_default();
    let parts_are_still = topology.parts.iter().all(|part| part.motion.is_empty());
    let still = parts_are_still && tracks().all(|track| track.is_identity());
    let lists = if disordered == 1 { "list" } else { "lists" };
    let note = || format!("{disordered} {lists} of keys out of order: put in order of time");
    let notes = (disordered > 0).then(note).into_iter().collect();
    let duration = if still { 0.0 } else { (end - start).min(f64::MAX) };
    // As the benchmark prescribes.
    let frames = time.map(|(_, _, frames)| frames);
    // At rest it is as posed below.
    let model = Model { topology, duration, frames, notes, ..Model::default() };
    let mut animation =
        AffAnimation { model, sources, nodes, start, origin, camera, camera_track, light, light_track };
    animation.pose(0.0, &mut rest);
    animation.model.rest = rest;
    Ok(animation)
}

impl AffAnimation {
    /// The time of the file's keys.
    fn key_time(&self, time: f64) -> f64 {
        self.start + self.model.clamp(time)
    }

    /// From the coordinates under each node to the world.
    fn to_world(&self, key_time: f64) -> Vec<DAffine3> {
        let mut to_world: Vec<DAffine3> = Vec::with_capacity(self.nodes.len());
        for (track, frame) in &self.nodes {
            to_world.push(resolve(&to_world, *frame) * track.transform(key_time));
        }
        to_world
    }
}

/// Places the parts where they are under nodes that move, or in the world, marks what moves, and
/// gives the positions there, those of patches at their first keys.
fn place_parts(topology: &mut Topology, sources: &mut [Source], places: &[Frame]) -> Vec<Vec3> {
    let mut positions = Vec::with_capacity(topology.vertex_count);
    for (part, source) in topology.parts.iter_mut().zip(sources) {
        let Frame { node, fixed } = place(places, Frame { node: source.node, ..Frame::default() });
        let Source { local, patches, .. } = source;
        if fixed != DAffine3::IDENTITY {
            let keys = patches.iter_mut().flat_map(|patch| &mut patch.0);
            let corners = local.iter_mut().chain(keys.flat_map(|(_, corners)| corners));
            corners.for_each(|p| *p = fixed.transform_point3(p.as_dvec3()).as_vec3());
        }
        positions.extend_from_slice(local);
        positions.extend(patches.iter().flat_map(|patch| patch.0[0].1));
        part.motion.set(Motion::RIGID, node.is_some());
        part.motion.set(Motion::KEY_FRAMES, patches.iter().any(Patch::moves));
        if part.motion.is_empty() {
            *source = Source::default();
            continue;
        }
        let moves = &mut topology.moves[part.triangles.start as usize..part.triangles.end as usize];
        moves.fill(node.is_some());
        for (moves, patch) in moves.iter_mut().zip(patches) {
            *moves |= patch.moves();
        }
        source.node = node;
    }
    positions
}

/// A frame whose node is one of `places`, as one whose node is what that is under.
fn place(places: &[Frame], frame: Frame) -> Frame {
    let outer = frame.node.map_or(Frame::default(), |node| places[node as usize]);
    Frame { node: outer.node, fixed: outer.fixed * frame.fixed }
}

fn resolve(to_world: &[DAffine3], frame: Frame) -> DAffine3 {
    frame.node.map_or(frame.fixed, |node| to_world[node as usize] * frame.fixed)
}

impl Animation for AffAnimation {
    fn model(&self) -> &Model {
        &self.model
    }

    fn pose_by(&self, kinds: Motion, time: f64, positions: &mut [Vec3]) -> PoseStats {
        assert_eq!(positions.len(), self.topology().vertex_count, "positions are those of another animation");
        let mut stats = PoseStats::default();
        let at = |on: bool| self.key_time(if on { time } else { 0.0 });
        let parts = self.model.topology.parts.iter().zip(&self.sources);
        let mut moving = parts.filter(|(part, _)| part.motion.intersects(kinds)).peekable();
        if moving.peek().is_none() {
            return stats;
        }
        let to_world: Vec<Affine3A> =
            self.to_world(at(kinds.contains(Motion::RIGID))).iter().map(DAffine3::as_affine3a).collect();
        for (part, Source { node, local, patches }) in moving {
            let Range { start, end } = part.vertices;
            let (positions, motion) = (&mut positions[start as usize..end as usize], part.motion & kinds);
            if patches.is_empty() {
                positions.copy_from_slice(local);
            } else {
                stats.key_frames.add_if(motion.contains(Motion::KEY_FRAMES), || {
                    for (corners, patch) in positions.as_chunks_mut::<3>().0.iter_mut().zip(patches) {
                        *corners = patch.at(at(kinds.contains(Motion::KEY_FRAMES)));
                    }
                    positions.len()
                });
            }
            if let Some(node) = *node {
                let to_world = to_world[node as usize];
                stats.rigid.add_if(motion.contains(Motion::RIGID), || {
                    positions.iter_mut().for_each(|p| *p = to_world.transform_point3(*p));
                    positions.len()
                });
            }
        }
        stats
    }

    /// The `v` block, moved by the track named `camera`; the camera of that track looks along its
    /// negative z axis.
    fn view(&self, time: f64) -> Option<View> {
        let (camera, track, time) = (self.camera.as_ref()?, &self.camera_track, self.key_time(time));
        let eye = track.translation.as_ref().map_or(camera.from, |eye| eye.at(time)) - self.origin;
        let (forward, up) = match track.rotation.as_ref().map(|rotation| rotation.at(time)) {
            Some(rotation) => (rotation * DVec3::NEG_Z, rotation * DVec3::Y),
            None => (camera.at - camera.from, camera.up),
        };
        // Far enough for the sum to keep the direction, wherever the eye is.
        let target = eye + forward.try_normalize()? * eye.length().max(1.0);
        let (eye, target, up) = (eye.as_vec3(), target.as_vec3(), up.try_normalize()?.as_vec3());
        let view = View { eye, target, up, fov_y: camera.fov_y as f32 };
        (eye.is_finite() && target.is_finite()).then_some(view)
    }

    /// One light for all: at the first one's place, with all their colours added up, to 1 at most.
    fn light(&self, time: f64) -> Option<Light> {
        let (light, time) = (self.light.as_ref()?, self.key_time(time));
        let translation = self.light_track.translation.as_ref();
        let position = translation.map_or(light.position, |translation| translation.at(time));
        let position = resolve(&self.to_world(time), light.frame).transform_point3(position).as_vec3();
        let color = light.color.as_vec3().to_array().map(|channel| channel.clamp(0.0, 1.0));
        position.is_finite().then_some(Light { position, color })
    }
}
