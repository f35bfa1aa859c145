//! How far a scene with few key frames is from the same scene with many.

use anim::Animation;
use glam::Vec3;

/// Distances between two animations of the same vertices, over all vertices and times compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// Root of the mean square, as a fraction of the extent.
    pub rms: f64,
    /// The greatest, as a fraction of the extent.
    pub max: f64,
    /// Diagonal of the box around the moving vertices of the second animation at all the times, a
    /// length.
    pub extent: f64,
}

/// Returns the distance of the moving vertices of `coarse` from those of `fine` at some times,
/// which are fractions of the loop: 0 is its first time, 1 its last.
///
/// This is the error of the accuracy knob
/// [`SceneOptions::key_frames`](crate::SceneOptions::key_frames) where `fine` is the same scene
/// with many more of them and as many simulation steps in all. Positions that are not finite in
/// either are left out. `None` if the two do not have the same vertices, none
/// of them moves, none is finite, or there is no time.
/// O(vertices * times).
#[must_use]
pub fn distance(
    coarse: &dyn Animation,
    fine: &dyn Animation,
    times: impl IntoIterator<Item = f64>,
) -> Option<Distance> {
    let moving = fine.topology().parts.iter().filter(|part| !part.motion.is_empty());
    let vertices: Vec<usize> =
        moving.flat_map(|part| part.vertices.start as usize..part.vertices.end as usize).collect();
    if vertices.is_empty() || coarse.topology().vertex_count != fine.topology().vertex_count {
        return None;
    }
    let (mut a, mut b) = (coarse.rest(), fine.rest());
    let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
    let (mut sum, mut max, mut count) = (0.0, 0.0_f64, 0_u64);
    for time in times {
        coarse.pose(time * coarse.duration(), &mut a);
        fine.pose(time * fine.duration(), &mut b);
        for (p, q) in vertices.iter().map(|&v| (a[v], b[v])).filter(|(p, q)| p.is_finite() && q.is_finite()) {
            let squared = p.as_dvec3().distance_squared(q.as_dvec3());
            (sum, max, count) = (sum + squared, max.max(squared), count + 1);
            (low, high) = (low.min(q), high.max(q));
        }
    }
    let extent = f64::from(low.distance(high));
    let [rms, max] = [sum / count as f64, max].map(|squared| squared.sqrt() / extent);
    (count > 0 && extent > 0.0).then_some(Distance { rms, max, extent })
}
