//! Tracing rays that have little in common: one diffuse bounce from what primary rays hit, the same
//! rays for everyone.

use std::time::Instant;

use anyhow::Result;
use bvh_core::{Bvh, Ray, Triangles};
use pivot_benches::{Answers, Contest, Hits, Rays, bounces};
use rayon::prelude::*;
use rt_cpu::{Bvh8, Pixel, TriangleTest, closest_hit};

use super::Setting;
use super::lane::{Frame, Lane, spread, view};
use super::row::{Record, Row, median};
use crate::interrupt;
use crate::progress::Progress;
use crate::stage::{Stage, ms};

/// Times that everyone traces the rays of a frame; the median counts.
const ROUNDS: usize = 5;

/// The time that the wide view takes to make, and those of the rays.
pub(super) fn measure(scene: &str, stage: &mut Stage, setting: &Setting) -> Result<(Row, Vec<Row>)> {
    let frames = stage.scene.frames.max(2);
    let measured = spread(frames, setting.frames);
    let progress =
        Progress::new(format!("incoherent, {scene}, {} threads", setting.threads), measured.len() as u64);
    let entries = setting.field(Contest::Incoherent);
    let mut lanes = entries.into_iter().map(|entry| Lane::new(entry, stage)).collect::<Result<Vec<_>>>()?;
    let (mut view_of_tree, mut making) = (Bvh8::new(), Record::default());
    let mut reference = Answers::default();
    let (mut count, mut done) = (0, 0);
    for (step, &frame) in measured.iter().enumerate() {
        if interrupt::requested() {
            break;
        }
        stage.pose(stage.time_of(frame, frames));
        let view = view(stage, setting.size);
        let seen = Frame::new(stage, &view)?;
        let mut times = [0.0; ROUNDS].map(|_: f64| {
            let start = Instant::now();
            view_of_tree.update(&seen.tree, &stage.triangles());
            ms(start)
        });
        times.sort_by(f64::total_cmp);
        making.times_ms.push(median(&times));
        let groups = bounces(&view.camera, &stage.triangles(), &seen.pixels, frame as u64);
        done += 1;
        count += groups.iter().map(Rays::len).sum::<usize>();
        let mut found: Vec<Hits> = groups.iter().map(|_| Hits::new()).collect();
        plain(&seen.tree, &stage.triangles(), &groups, &mut found);
        let expected = answers(&groups, &found);
        reference.add(&expected, &expected);
        for lane in &mut lanes {
            lane.update(stage)?;
            lane.add_cost(&seen);
        }
        let mut times = vec![Vec::new(); lanes.len()];
        for round in 0..ROUNDS {
            let lane_count = lanes.len();
            for i in (0..lane_count).map(|i| (i + round + step) % lane_count) {
                let start = Instant::now();
                cast(&lanes[i], &groups, &mut found);
                times[i].push(ms(start));
                if round == 0 {
                    lanes[i].record.answers.add(&answers(&groups, &found), &expected);
                }
            }
        }
        for (lane, mut times) in lanes.iter_mut().zip(times) {
            times.sort_by(f64::total_cmp);
            lane.record.times_ms.push(median(&times));
        }
        progress.at(step as u64 + 1);
    }
    let rays_a_frame = count as f64 / f64::from(done.max(1));
    let row = |lane: &Lane| {
        let row = lane.row("incoherent", scene, stage, setting.threads, &reference);
        Row { million_rays_per_s: Some(rays_a_frame / (row.median_ms * 1e3)), ..row }
    };
    let triangles = stage.triangles().indices.len();
    let making = making.row("view", scene, triangles, "pivot wide", setting.threads, &Answers::default());
    Ok((making, lanes.iter().map(row).collect()))
}

/// Ray by ray through the tree itself: what everyone is to find.
fn plain(tree: &Bvh, triangles: &Triangles<'_>, groups: &[Rays], found: &mut [Hits]) {
    let closest = |ray: &Ray, t_max| closest_hit(tree, triangles, ray, t_max, TriangleTest::default());
    groups.par_iter().zip(found).for_each(|(rays, hits)| {
        (0..rays.len()).for_each(|i| hits.set(i, closest(&rays.ray(i), rays.t_max[i])));
    });
}

fn cast(lane: &Lane, groups: &[Rays], found: &mut [Hits]) {
    groups.par_iter().zip(found).for_each(|(rays, hits)| lane.contestant.closest(rays, hits));
}

/// What the rays hit, in the form that views are compared in.
fn answers(groups: &[Rays], found: &[Hits]) -> Vec<Pixel> {
    let of = |(rays, hits): (&Rays, &Hits)| {
        (0..rays.len()).map(|i| Pixel::new(hits.get(i), false)).collect::<Vec<_>>()
    };
    groups.iter().zip(found).flat_map(of).collect()
}
