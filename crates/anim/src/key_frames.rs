//! Meshes whose positions are interpolated linearly between key frames.

use std::ops::Range;

use glam::Vec3;

use crate::{Animation, Model, Motion, Part, PoseStats, Problem};

/// Time from one key frame to the next where nothing else is known, in seconds.
pub const DEFAULT_SECONDS_PER_FRAME: f64 = 1.0 / 24.0;

/// A key-framed animation: vertices move in straight lines, at constant speed from key to key.
///
/// The loop ends at the last key frame; the next begins with a jump back to the first one, as in
/// the paper (section 4).
///
/// Per key frame only the vertices that ever move are kept, 12 bytes each.
#[derive(Clone, Debug)]
pub struct KeyFrames {
    /// Its rest positions are the first key frame.
    model: Model,
    /// The vertices that move, as runs of consecutive numbers.
    moving: Vec<Range<usize>>,
    /// The positions of those, run behind run, for each key frame.
    frames: Vec<Vec<Vec3>>,
    seconds_per_frame: f64,
}

impl KeyFrames {
    /// Makes an animation from the rest positions of `model` through the positions of `more` key
    /// frames, `seconds_per_frame` apart; each has one position per vertex.
    ///
    /// Which vertices move is found out here, by comparing the frames bit for bit: `moves` of the
    /// topology, the motion of its parts and the duration are set accordingly, whatever they were.
    /// Without more frames it is a still mesh. O(vertices * frames); beside the result, memory for
    /// one more frame.
    ///
    /// # Errors
    /// If a frame does not have one position for each vertex, a triangle or a part names a vertex
    /// or a material that is not there, a triangle is not in one part, or the time is not positive
    /// and finite.
    pub fn new(mut model: Model, more: Vec<Vec<Vec3>>, seconds_per_frame: f64) -> Result<Self, Problem> {
        if !(seconds_per_frame > 0.0 && seconds_per_frame.is_finite()) {
            let found = format!("{seconds_per_frame} seconds from one to the next");
            return Err(Problem::new("key frames", found, "a positive finite number"));
        }
        let mut frames: Vec<_> = std::iter::once(model.rest.clone()).chain(more).collect();
        let (rest, topology) = (&model.rest, &mut model.topology);
        let count = topology.vertex_count;
        if let Some((number, frame)) = frames.iter().enumerate().find(|(_, frame)| frame.len() != count) {
            let (place, found) = (format!("key frame {number}"), format!("{} positions", frame.len()));
            return Err(Problem::new(place, found, format!("{count}, one for each vertex")));
        }
        let corners_exist = topology.triangles.as_flattened().iter().all(|&corner| (corner as usize) < count);
        let exist = |range: &Range<u32>, count| range.start <= range.end && range.end as usize <= count;
        let mut covered = 0;
        let fits = |part: &Part| {
            exist(&part.vertices, count)
                && exist(&part.triangles, topology.triangles.len())
                && std::mem::replace(&mut covered, part.triangles.end) == part.triangles.start
                && (part.material as usize) < topology.materials.len()
        };
        let parts_fit = topology.parts.iter().all(fits) && covered as usize == topology.triangles.len();
        if !corners_exist || !parts_fit {
            let expected = "vertices and materials that are there, and each triangle in one part";
            return Err(Problem::new("topology", "triangles or parts of others", expected));
        }

        let mut moves = vec![false; rest.len()];
        let bits = |position: &Vec3| position.to_array().map(f32::to_bits);
        for frame in &frames[1..] {
            for (moves, (a, b)) in moves.iter_mut().zip(rest.iter().zip(frame)) {
                *moves |= bits(a) != bits(b);
            }
        }
        let moving = runs(&moves);
        for frame in &mut frames {
            // One after the other, so that never more than one frame is held twice.
            let kept: Vec<&[Vec3]> = moving.iter().map(|run| &frame[run.clone()]).collect();
            *frame = kept.concat();
        }

        let corner_moves = |&corner: &u32| moves[corner as usize];
        topology.moves = topology.triangles.iter().map(|corners| corners.iter().any(corner_moves)).collect();
        for part in &mut topology.parts {
            let moves = moves[part.vertices.start as usize..part.vertices.end as usize].contains(&true);
            part.motion = if moves { Motion::KEY_FRAMES } else { Motion::empty() };
        }
        // Of finite times the sum may not be.
        let way = ((frames.len() - 1) as f64 * seconds_per_frame).min(f64::MAX);
        model.duration = if moving.is_empty() { 0.0 } else { way };
        Ok(Self { model, moving, frames, seconds_per_frame })
    }

    /// The key frame at or before `time`, and how far it is on the way to the next, in [0, 1).
    fn position_in_time(&self, time: f64) -> (usize, f32) {
        let last = (self.frames.len() - 1) as f64;
        let at = (self.model.clamp(time) / self.seconds_per_frame).min(last);
        // The time of a key, computed by whoever asks, is that of the key only up to rounding.
        let nearest = at.round();
        if (at - nearest).abs() < 1e-7 {
            return (nearest as usize, 0.0);
        }
        (at.floor() as usize, at.fract() as f32)
    }

    /// Writes the vertices that move and gives their number.
    fn blend(&self, time: f64, positions: &mut [Vec3]) -> usize {
        let (frame, u) = self.position_in_time(time);
        let mut from = &self.frames[frame][..];
        let mut to = self.frames.get(frame + 1).map_or(from, Vec::as_slice);
        for run in &self.moving {
            let out = &mut positions[run.clone()];
            let (a, b);
            (a, from) = from.split_at(out.len());
            (b, to) = to.split_at(out.len());
            if u == 0.0 {
                // On a key exactly, also where the next key is not finite.
                out.copy_from_slice(a);
            } else {
                // As plain numbers, so that the compiler fills whole registers.
                let (a, b): (&[f32], &[f32]) = (bytemuck::cast_slice(a), bytemuck::cast_slice(b));
                for (out, (a, b)) in bytemuck::cast_slice_mut(out).iter_mut().zip(a.iter().zip(b)) {
                    *out = a + (b - a) * u;
                }
            }
        }
        self.frames[frame].len()
    }
}

impl Animation for KeyFrames {
    fn model(&self) -> &Model {
        &self.model
    }

    fn pose_by(&self, kinds: Motion, time: f64, positions: &mut [Vec3]) -> PoseStats {
        assert_eq!(positions.len(), self.topology().vertex_count, "positions are those of another animation");
        let mut stats = PoseStats::default();
        if kinds.contains(Motion::KEY_FRAMES) {
            stats.key_frames.add(|| self.blend(time, positions));
        }
        stats
    }
}

/// Where `time` falls among keys in order of time: the last key at or before it, else the first;
/// how far it is from there to the next, in [0, 1]; and how long that way takes. There is no way
/// before the first key and behind the last.
pub(crate) fn segment<K>(keys: &[K], time: f64, time_of: impl Fn(&K) -> f64) -> (usize, f32, f64) {
    let after = keys.partition_point(|key| time_of(key) <= time);
    let first = after.saturating_sub(1);
    let Some(next) = keys.get(after).filter(|_| after > 0) else { return (first, 0.0, 0.0) };
    let begin = time_of(&keys[first]);
    let length = time_of(next) - begin;
    (first, ((time - begin) / length) as f32, length)
}

/// The numbers of the `true` elements as ranges.
fn runs(flags: &[bool]) -> Vec<Range<usize>> {
    let mut end = 0;
    let runs = flags.chunk_by(|a, b| a == b).filter_map(|run| {
        end += run.len();
        run[0].then(|| end - run.len()..end)
    });
    runs.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Material, Topology};

    /// A still triangle (vertices 0 to 2) and one whose last two vertices move.
    fn model(rest: Vec<Vec3>) -> Model {
        let part = |name: &str, triangles, vertices| Part {
            name: name.into(),
            triangles,
            vertices,
            motion: Motion::empty(),
            material: 0,
        };
        let topology = Topology {
            triangles: vec![[0, 1, 2], [3, 4, 5]],
            vertex_count: 6,
            moves: Vec::new(),
            parts: vec![part("still", 0..1, 0..3), part("moving", 1..2, 3..6)],
            materials: vec![Material::default()],
            ..Topology::default()
        };
        Model { topology, rest, ..Model::default() }
    }

    fn key_frames(mut frames: Vec<Vec<Vec3>>, seconds_per_frame: f64) -> Result<KeyFrames, Problem> {
        KeyFrames::new(model(frames.remove(0)), frames, seconds_per_frame)
    }

    fn frame(x: f32) -> Vec<Vec3> {
        let mut frame: Vec<Vec3> = (0..6).map(|i| Vec3::new(i as f32, 0.0, 0.0)).collect();
        frame[4].y = x;
        frame[5].z = 2.0 * x;
        frame
    }

    fn at(animation: &KeyFrames, time: f64) -> Vec<Vec3> {
        let mut positions = animation.rest();
        animation.pose(time, &mut positions);
        positions
    }

    #[test]
    fn interpolates_and_keeps_only_what_moves() {
        let frames = vec![frame(0.0), frame(1.0), frame(3.0)];
        let animation = key_frames(frames, 0.5).unwrap();
        assert_eq!(animation.duration(), 1.0);
        assert_eq!(animation.frames[0].len(), 2);
        assert_eq!(animation.topology().moves, [false, true]);
        assert!(animation.topology().parts[0].motion.is_empty());
        assert!(animation.topology().parts[1].motion.contains(Motion::KEY_FRAMES));
        for (time, x) in
            [(0.0, 0.0), (0.25, 0.5), (0.5, 1.0), (0.75, 2.0), (1.0, 3.0), (9.0, 3.0), (-1.0, 0.0)]
        {
            assert_eq!(at(&animation, time), frame(x), "at {time}");
        }
        assert_eq!(at(&animation, f64::NAN), frame(0.0));
        assert_eq!(at(&animation, f64::INFINITY), frame(3.0));
    }

    #[test]
    fn vertices_that_stand_still_are_never_written() {
        let animation = key_frames(vec![frame(0.0), frame(1.0)], 1.0).unwrap();
        let mut positions = vec![Vec3::NAN; 6];
        animation.pose(0.3, &mut positions);
        assert_eq!(
            positions.iter().map(|p| p.is_nan()).collect::<Vec<_>>(),
            [true, true, true, true, false, false]
        );
    }

    #[test]
    fn back_and_forth() {
        let frames = [0.0, 1.0, 3.0, 1.0, 0.0].map(frame).to_vec();
        let animation = key_frames(frames, 1.0).unwrap();
        assert_eq!(animation.duration(), 4.0);
        for (time, x) in [(1.5, 2.0), (2.0, 3.0), (2.5, 2.0), (3.0, 1.0), (3.5, 0.5), (4.0, 0.0)] {
            assert_eq!(at(&animation, time), frame(x), "at {time}");
        }
    }

    #[test]
    fn a_single_frame_stands_still() {
        let animation = key_frames(vec![frame(2.0)], 1.0).unwrap();
        assert_eq!(animation.duration(), 0.0);
        assert_eq!(animation.topology().moves, [false, false]);
        assert_eq!(at(&animation, 5.0), frame(2.0));
    }

    #[test]
    fn a_vertex_that_is_infinite_in_one_key_comes_back() {
        let mut broken = frame(1.0);
        broken[4] = Vec3::INFINITY;
        let animation = key_frames(vec![frame(0.0), broken, frame(3.0)], 1.0).unwrap();
        assert_eq!(at(&animation, 0.0), frame(0.0));
        assert!(!at(&animation, 0.5)[4].is_finite());
        assert_eq!(at(&animation, 2.0), frame(3.0));
    }

    #[test]
    fn key_times_hit_keys_exactly() {
        let frames: Vec<_> = (0..100).map(|i| frame((i as f32).sqrt())).collect();
        let animation = key_frames(frames.clone(), 1.0 / 24.0).unwrap();
        for (number, frame) in frames.iter().enumerate() {
            assert_eq!(&at(&animation, number as f64 / 24.0), frame);
            assert_eq!(&at(&animation, animation.duration() * number as f64 / 99.0), frame);
        }
    }

    #[test]
    fn misfits_are_errors() {
        let short = || frame(0.0)[..5].to_vec();
        for (number, frames) in [vec![short()], vec![frame(0.0), short()]].into_iter().enumerate() {
            let expected = format!("key frame {number}: found 5 positions, expected 6, one for each vertex");
            assert_eq!(key_frames(frames, 1.0).unwrap_err().to_string(), expected);
        }
        let mut models = [(); 5].map(|()| model(frame(0.0)));
        models[0].topology.triangles[1][2] = 6;
        models[1].topology.parts[1].vertices = 3..7;
        models[2].topology.parts[1].triangles = 1..3;
        models[3].topology.parts[0].material = 7;
        models[4].topology.parts.truncate(1);
        for model in models {
            let expected = "topology: found triangles or parts of others, expected vertices and materials \
                            that are there, and each triangle in one part";
            assert_eq!(KeyFrames::new(model, Vec::new(), 1.0).unwrap_err().to_string(), expected);
        }
        for seconds in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(key_frames(vec![frame(0.0)], seconds).is_err());
        }
    }

    #[test]
    fn runs_of_flags() {
        assert_eq!(runs(&[]), []);
        assert_eq!(runs(&[true, false, true, true]), [0..1, 2..4]);
    }
}
