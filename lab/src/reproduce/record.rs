//! A row of measurements.

use serde::{Deserialize, Serialize};

/// One strategy on one frame. The names and the order of the columns are relied on by scripts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Row {
    pub(crate) scene: String,
    pub(crate) strategy: String,
    pub(crate) threads: usize,
    /// Loop of the animation, from 0.
    #[serde(rename = "loop")]
    pub(crate) round: usize,
    /// Frame in the loop, from 0.
    pub(crate) frame: usize,
    /// Posing the scene, once for all strategies; in no other column.
    pub(crate) animate_ms: f64,
    pub(crate) update_ms: f64,
    pub(crate) trace_ms: f64,
    /// Update and trace.
    pub(crate) frame_ms: f64,
    pub(crate) sah_cost: f64,
    pub(crate) rotations: u64,
    pub(crate) height: u32,
    pub(crate) nodes_visited: u64,
    pub(crate) rays_primary: u64,
    pub(crate) rays_shadow: u64,
    pub(crate) hits: u64,
    /// Primitives without finite coordinates that the update visited.
    pub(crate) dropped: u64,
    /// Frames in a loop.
    pub(crate) frames_per_loop: usize,
    /// Time in the animation, in seconds.
    pub(crate) time_s: f64,
    /// What posing did, once for all strategies.
    pub(crate) vertices_blended: u64,
    pub(crate) vertices_morphed: u64,
    pub(crate) vertices_skinned: u64,
    pub(crate) vertices_rigid: u64,
    pub(crate) blend_ms: f64,
    pub(crate) morph_ms: f64,
    pub(crate) skin_ms: f64,
    pub(crate) rigid_ms: f64,
    /// Primitives whose boxes the update asked for.
    pub(crate) primitives_refit: u64,
    /// What the update decided to do, in words without commas; `as always` for what does the same
    /// every time.
    pub(crate) decision: String,
    /// Surfaces with a colour from a texture.
    pub(crate) textured: u64,
    /// Rays traced a second time because of a hole.
    pub(crate) rays_again: u64,
    pub(crate) rays_mirror: u64,
    pub(crate) rays_ambient_occlusion: u64,
    pub(crate) rays_bounce: u64,
    /// What the stages took of `trace_ms`.
    pub(crate) primary_ms: f64,
    pub(crate) alpha_ms: f64,
    pub(crate) textures_ms: f64,
    pub(crate) shadow_ms: f64,
    pub(crate) mirror_ms: f64,
    pub(crate) ambient_occlusion_ms: f64,
    pub(crate) diffuse_bounces_ms: f64,
    /// Nodes that the rays opened, once for each ray or packet.
    pub(crate) nodes_opened: u64,
    /// Updates since the row before, with this one, and their time.
    #[serde(default)]
    pub(crate) updates: u64,
    #[serde(default)]
    pub(crate) updates_ms: f64,
}

impl Row {
    /// Frames since the first one of all loops.
    pub(crate) fn step(&self) -> usize {
        self.round * self.frames_per_loop + self.frame
    }
}

/// Mean time of a strategy's updates up to the last row, those between rows included: rare ones may
/// be long. Not a number if there are no rows.
pub(crate) fn mean_update_ms(rows: &[&Row]) -> f64 {
    let updates = rows.iter().map(|row| row.updates).sum::<u64>();
    if updates > 0 {
        return rows.iter().map(|row| row.updates_ms).sum::<f64>() / updates as f64;
    }
    // Rows of older revisions do not count updates.
    rows.iter().map(|row| row.update_ms).sum::<f64>() / rows.len() as f64
}

/// Mean time of a strategy's frames: that of updates, and of the pictures that were rendered.
pub(crate) fn mean_frame_ms(rows: &[&Row]) -> f64 {
    mean_update_ms(rows) + rows.iter().map(|row| row.trace_ms).sum::<f64>() / rows.len() as f64
}

/// Milliseconds to a tenth of a microsecond, as rows have them.
pub(crate) fn rounded(ms: f64) -> f64 {
    (ms * 1e4).round() / 1e4
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_frame_counts_updates_between_rows() {
        let row = Row { update_ms: 1.0, trace_ms: 10.0, ..Row::default() };
        let later = Row { update_ms: 9.0, ..row.clone() };
        // Four updates of 1 ms between the two rows.
        let [first, second] = [(1, 1.0), (5, 13.0)];
        let with = |row: &Row, (updates, updates_ms)| Row { updates, updates_ms, ..row.clone() };
        assert_eq!(mean_frame_ms(&[&with(&row, first), &with(&later, second)]), 14.0 / 6.0 + 10.0);
        assert_eq!(mean_frame_ms(&[&row, &later]), 15.0, "rows of before these columns");
        assert!(mean_frame_ms(&[]).is_nan());
    }
}
