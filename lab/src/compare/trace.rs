//! Tracing through trees that are fresh in each measured frame: primary rays and shadow rays
//! towards the point light; and rays that have little in common, one diffuse bounce from what
//! primary rays hit, the same rays for everyone.

use anyhow::Result;
use bvh_core::{Bvh, Ray, Triangles};
use pivot_benches::{Answers, Contest, Contestant, Hits, Rays, bounces, set_up_rays};
use rayon::prelude::*;
use rt_cpu::{Bvh8, Pixel, TriangleTest, closest_hit};

use super::Setting;
use super::lane::{Frame, in_rounds, lanes, play, rows, view};
use super::row::{Record, Row};
use crate::reproduce::median;
use crate::stage::{Stage, timed};

/// Times that everyone traces the rays of a frame, primary ones and bounces; the median counts.
const ROUNDS: usize = 3;
const BOUNCE_ROUNDS: usize = 5;

/// Name of the row with the time of making rays where shadow rays are made from corners: what
/// contestants that return no normals spend outside of the library, their user's part.
pub(super) const SET_UP: &str = "ray set-up";

/// Milliseconds of the median of `N` runs.
fn median_of<const N: usize>(mut run: impl FnMut()) -> f64 {
    median([(); N].map(|()| timed(&mut run).1))
}

/// Makes the rays of a view, and records the time.
pub(super) fn set_up(record: &mut Record, stage: &Stage, expected: &Frame, pixels: &mut [Pixel]) {
    let time = median_of::<3>(|| set_up_rays(&stage.triangles(), &expected.view, &expected.pixels, pixels));
    record.times_ms.push(time);
    record.answers.add(pixels, &expected.pixels);
}

/// Rows with the rays a second; as many `rays` were cast in each frame measured, on average.
fn with_rates(rows: Vec<Row>, rays: u64) -> impl Iterator<Item = Row> {
    rows.into_iter().map(move |row| {
        let rays_a_frame = rays as f64 / row.frames.max(1) as f64;
        Row { million_rays_per_s: Some(rays_a_frame / (row.median_ms * 1e3)), ..row }
    })
}

pub(super) fn primary(stage: &mut Stage, setting: &Setting) -> Result<Vec<Row>> {
    let mut lanes = lanes(Contest::Trace, stage, setting)?;
    let (mut reference, mut making, mut rays) = (Answers::default(), Record::default(), 0);
    let mut pixels = vec![Pixel::default(); setting.size as usize * setting.size as usize];
    play("trace", stage, setting, false, |stage, turn, _| {
        let expected = Frame::new(stage, view(stage, setting.size))?;
        reference.add(&expected.pixels, &expected.pixels);
        rays += expected.stats.rays_primary + expected.stats.rays_shadow;
        for lane in &mut lanes {
            lane.update(stage)?;
            lane.add_cost(&expected);
        }
        set_up(&mut making, stage, &expected, &mut pixels);
        let cast = |contestant: &dyn Contestant, pixels: &mut Vec<Pixel>| {
            contestant.cast(&expected.view, pixels);
        };
        in_rounds((ROUNDS, turn), &mut lanes, &mut pixels, &expected.pixels, cast, Vec::clone);
        Ok(())
    })?;
    let rows = rows("trace", &lanes, setting, &reference);
    let making = making.row("trace", SET_UP, setting, &reference);
    Ok(with_rates(rows, rays).chain([making]).collect())
}

/// The time that the wide view takes to make, and those of the rays.
pub(super) fn incoherent(stage: &mut Stage, setting: &Setting) -> Result<Vec<Row>> {
    let mut lanes = lanes(Contest::Incoherent, stage, setting)?;
    let (mut wide, mut making) = (Bvh8::new(), Record::default());
    let (mut reference, mut count) = (Answers::default(), 0);
    play("incoherent", stage, setting, false, |stage, turn, _| {
        let seen = Frame::new(stage, view(stage, setting.size))?;
        let time = median_of::<BOUNCE_ROUNDS>(|| wide.update(&seen.tree, &stage.triangles()));
        making.times_ms.push(time);
        let groups = bounces(&seen.view.camera, &stage.triangles(), &seen.pixels, turn as u64);
        count += groups.iter().map(Rays::len).sum::<usize>() as u64;
        let mut found: Vec<Hits> = groups.iter().map(|_| Hits::default()).collect();
        plain(&seen.tree, &stage.triangles(), &groups, &mut found);
        let expected = answers(&groups, &found);
        reference.add(&expected, &expected);
        for lane in &mut lanes {
            lane.update(stage)?;
            lane.add_cost(&seen);
        }
        let cast = |contestant: &dyn Contestant, found: &mut Vec<Hits>| {
            groups.par_iter().zip(found).for_each(|(rays, hits)| contestant.closest(rays, hits));
        };
        let turn = (BOUNCE_ROUNDS, turn);
        in_rounds(turn, &mut lanes, &mut found, &expected, cast, |found| answers(&groups, found));
        Ok(())
    })?;
    let making = making.row("view", "pivot wide", setting, &Answers::default());
    let making = Some(making).filter(|row| setting.is_named(&row.contestant));
    let rows = rows("incoherent", &lanes, setting, &reference);
    Ok(making.into_iter().chain(with_rates(rows, count)).collect())
}

/// Ray by ray through the tree itself: what everyone is to find.
fn plain(tree: &Bvh, triangles: &Triangles<'_>, groups: &[Rays], found: &mut [Hits]) {
    let closest = |ray: &Ray, t_max| closest_hit(tree, triangles, ray, t_max, TriangleTest::default());
    groups.par_iter().zip(found).for_each(|(rays, hits)| {
        (0..rays.len()).for_each(|i| hits.set(i, closest(&rays.ray(i), rays.t_max[i])));
    });
}

/// What the rays hit, in the form that views are compared in.
fn answers(groups: &[Rays], found: &[Hits]) -> Vec<Pixel> {
    let of = |(rays, hits): (&Rays, &Hits)| {
        (0..rays.len()).map(|i| Pixel::new(hits.get(i), false)).collect::<Vec<_>>()
    };
    groups.iter().zip(found).flat_map(of).collect()
}
