//! What the stages of a frame did and how long they took, over the frames measured.

use std::time::Duration;

use anim::PoseStats;
use bvh_core::Bvh;
use bvh_update::{Decision, Update};
use rt_cpu::RenderStats;
use scenes::FrameStage;
use serde::{Deserialize, Serialize};

use super::record::{Row, mean_update_ms, rounded};

/// A stage of a strategy's frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct StageSummary {
    pub(crate) stage: String,
    /// What it counts.
    pub(crate) counts: String,
    /// How many of those in all frames together.
    pub(crate) count: u64,
    /// Time a frame, on average.
    pub(crate) mean_ms: f64,
}

/// The stages that are planned, and any that ran though it was not, in the order they run.
pub(crate) fn stages(planned: &[String], rows: &[&Row]) -> Vec<StageSummary> {
    let count = |of: fn(&Row) -> u64| rows.iter().map(|row| of(row)).sum();
    let mean = |of: fn(&Row) -> f64| rows.iter().map(|row| of(row)).sum::<f64>() / rows.len().max(1) as f64;
    // Of each of `FrameStage::ALL`.
    let columns = [
        ("vertices", count(|r| r.vertices_blended), mean(|r| r.blend_ms)),
        ("displacements", count(|r| r.vertices_morphed), mean(|r| r.morph_ms)),
        ("vertices", count(|r| r.vertices_skinned), mean(|r| r.skin_ms)),
        ("vertices", count(|r| r.vertices_rigid), mean(|r| r.rigid_ms)),
        ("primitives", count(|r| r.primitives_refit), mean_update_ms(rows)),
        ("rays", count(|r| r.rays_primary), mean(|r| r.primary_ms)),
        ("rays again", count(|r| r.rays_again), mean(|r| r.alpha_ms)),
        ("surfaces", count(|r| r.textured), mean(|r| r.textures_ms)),
        ("rays", count(|r| r.rays_shadow), mean(|r| r.shadow_ms)),
        ("rays", count(|r| r.rays_mirror), mean(|r| r.mirror_ms)),
        ("rays", count(|r| r.rays_ambient_occlusion), mean(|r| r.ambient_occlusion_ms)),
        ("rays", count(|r| r.rays_bounce), mean(|r| r.diffuse_bounces_ms)),
    ];
    let summary = |(stage, (counts, count, mean_ms)): (FrameStage, (&str, u64, f64))| StageSummary {
        stage: stage.name(),
        counts: counts.to_owned(),
        count,
        mean_ms,
    };
    let all = FrameStage::ALL.into_iter().zip(columns).map(summary);
    all.filter(|summary| summary.count > 0 || planned.contains(&summary.stage)).collect()
}

/// Primitives whose boxes an update asks for: those of leaves that move, or all for a new tree, be
/// it given up.
pub(crate) fn primitives_refit(tree: &Bvh, update: &Update) -> u64 {
    if update.rebuilt || matches!(update.decision, Decision::Kept { .. }) {
        return tree.len() as u64;
    }
    let mut count = 0;
    tree.visit(|_, node, _| {
        count += if node.is_leaf() && node.is_dynamic() { node.count() as u64 } else { 0 }
    });
    count
}

impl Row {
    /// The same row with what posing its frame did.
    pub(crate) fn posed(self, stats: &PoseStats) -> Self {
        let ms = |work: anim::Work| rounded(work.time.as_secs_f64() * 1e3);
        Self {
            vertices_blended: stats.key_frames.count,
            vertices_morphed: stats.morph.count,
            vertices_skinned: stats.skin.count,
            vertices_rigid: stats.rigid.count,
            blend_ms: ms(stats.key_frames),
            morph_ms: ms(stats.morph),
            skin_ms: ms(stats.skin),
            rigid_ms: ms(stats.rigid),
            ..self
        }
    }

    /// The same row with what rendering its frame did in `trace_ms`, which is rounded. Times of
    /// stages are added up over threads; their parts of the sum are their parts of the time that
    /// passed.
    pub(crate) fn traced(self, stats: &RenderStats, trace_ms: f64) -> Self {
        let total = stats.times.total().as_secs_f64();
        let ms =
            |time: Duration| if total > 0.0 { rounded(trace_ms * time.as_secs_f64() / total) } else { 0.0 };
        Self {
            trace_ms: rounded(trace_ms),
            rays_primary: stats.rays_primary,
            rays_shadow: stats.rays_shadow,
            hits: stats.hits,
            textured: stats.textured,
            rays_again: stats.rays_again,
            rays_mirror: stats.rays_mirror,
            rays_ambient_occlusion: stats.rays_ambient_occlusion,
            rays_bounce: stats.rays_bounce,
            primary_ms: ms(stats.times.primary),
            alpha_ms: ms(stats.times.alpha),
            textures_ms: ms(stats.times.textures),
            shadow_ms: ms(stats.times.shadow),
            mirror_ms: ms(stats.times.mirror),
            ambient_occlusion_ms: ms(stats.times.ambient_occlusion),
            diffuse_bounces_ms: ms(stats.times.diffuse_bounces),
            nodes_opened: stats.nodes_visited,
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use anim::Motion;
    use bvh_core::{Aabb, Primitives, Triangles};
    use bvh_update::{Rotate, Strategy, Updater};
    use rt_cpu::{Image, StageTimes, render};
    use scenes::{LightEffects, Scene, SceneOptions};

    use super::*;
    use crate::stage::{self, Stage};

    /// Triangles that count how often they are asked for their boxes.
    struct Asked<'a>(Triangles<'a>, AtomicU64);

    impl Primitives for Asked<'_> {
        fn len(&self) -> usize {
            Primitives::len(&self.0)
        }

        fn bounds(&self, i: usize) -> Aabb {
            self.1.fetch_add(1, Ordering::Relaxed);
            self.0.aabb(i)
        }
    }

    fn scene(name: &str) -> Scene {
        let options = SceneOptions {
            detail: Some(0.02),
            substeps: Some(4),
            key_frames: Some(8),
            ..SceneOptions::default()
        };
        scenes::load(name, None, &options).unwrap()
    }

    fn traced(stage: &Stage) -> RenderStats {
        let (camera, light, options) = (stage.camera(48, 48), stage.light(), stage.render_options());
        let mut image = Image::new(48, 48);
        render(&stage.first_tree, &stage.mesh(), &camera, Some(&light), &options, &mut image)
    }

    #[test]
    fn only_planned_stages_run_and_only_what_moves_is_posed_and_refit() {
        for info in scenes::list() {
            let mut stage = stage::ready(scene(info.name)).unwrap();
            let topology = stage.scene.animation.topology();
            let moving = topology.moves.iter().filter(|&&moves| moves).count() as u64;
            let vertices = |kinds: Motion| -> u64 {
                let parts = topology.parts.iter().filter(|p| p.motion.intersects(kinds));
                parts.map(|p| p.vertices.len() as u64).sum()
            };
            let [skinned, rigid] = [Motion::SKIN, Motion::RIGID].map(vertices);
            let moving_vertices = vertices(Motion::all());
            // Of the cloth and its ball nothing stands still.
            let all_dynamic = moving == topology.triangles.len() as u64;
            assert_eq!(all_dynamic, info.name == "cloth-ball", "{}", info.name);

            assert_eq!(stage.pose(0.0), PoseStats::default(), "{}: it is there already", info.name);
            let time = stage.time_of(1, 3);
            let stats = stage.pose(time);
            for (frame_stage, work) in [
                (FrameStage::Motion(Motion::KEY_FRAMES), stats.key_frames),
                (FrameStage::Motion(Motion::MORPH), stats.morph),
                (FrameStage::Motion(Motion::SKIN), stats.skin),
                (FrameStage::Motion(Motion::RIGID), stats.rigid),
            ] {
                let called_for = stage.scene.effects.calls_for(frame_stage);
                assert_eq!(work.count > 0, called_for, "{}, {}", info.name, frame_stage.name());
            }
            assert_eq!((stats.skin.count, stats.rigid.count), (skinned, rigid), "{}", info.name);
            assert!(stats.key_frames.count <= moving_vertices, "{}", info.name);
            assert_eq!(stage.pose(time), PoseStats::default(), "{}: a repeated time", info.name);

            for strategy in [Strategy::Refit, Strategy::RefitRotate(Rotate::default())] {
                let mut tree = Bvh::clone(&stage.first_tree);
                let asked = Asked(stage.triangles(), AtomicU64::new(0));
                let done = Updater::new(strategy).update(&mut tree, &asked).unwrap();
                assert_eq!(
                    asked.1.into_inner(),
                    moving,
                    "{}: each is asked once, what is static never",
                    info.name
                );
                assert_eq!(primitives_refit(&tree, &done), moving, "{}", info.name);
                assert!(done.nodes_visited < 3 * moving + 100, "{}: {}", info.name, done.nodes_visited);
            }
        }
    }

    #[test]
    fn a_scene_without_lights_casts_no_shadow_ray() {
        let mut lit = scene("n-body");
        let stats = traced(&stage::ready(scene("n-body")).unwrap());
        assert!(stats.rays_shadow > 0);
        lit.effects.light = LightEffects::empty();
        let dark = traced(&stage::ready(lit).unwrap());
        assert_eq!((dark.rays_shadow, dark.rays_primary), (0, stats.rays_primary));
    }

    #[test]
    fn stages_of_a_picture_share_its_time() {
        let untimed = traced(&stage::ready(scene("n-body")).unwrap());
        // Of two threads, on a clock of 5 ms.
        let [primary, shadow] = [6, 2].map(Duration::from_millis);
        let stats = RenderStats { times: StageTimes { primary, shadow, ..StageTimes::default() }, ..untimed };
        let row = Row::default().traced(&stats, 5.0);
        assert_eq!(row.nodes_opened, stats.nodes_visited);
        assert_eq!((row.primary_ms, row.shadow_ms, row.trace_ms), (3.75, 1.25, 5.0));
        let absent = [row.alpha_ms, row.textures_ms, row.mirror_ms, row.ambient_occlusion_ms];
        assert_eq!((absent, row.diffuse_bounces_ms), ([0.0; 4], 0.0));
        let untimed = Row::default().traced(&untimed, 5.0);
        assert_eq!((untimed.primary_ms, untimed.shadow_ms, untimed.trace_ms), (0.0, 0.0, 5.0));
    }

    #[test]
    fn planned_stages_are_listed_and_unplanned_ones_only_if_they_ran() {
        let row =
            Row { vertices_skinned: 7, skin_ms: 3.0, primary_ms: 5.0, rays_primary: 4, ..Row::default() };
        let planned = ["primary", "shadow"].map(str::to_owned);
        let stages = stages(&planned, &[&row, &row]);
        let found: Vec<_> = stages.iter().map(|s| (s.stage.as_str(), s.count, s.mean_ms)).collect();
        assert_eq!(found, [("skin", 14, 3.0), ("primary", 8, 5.0), ("shadow", 0, 0.0)]);
    }
}
