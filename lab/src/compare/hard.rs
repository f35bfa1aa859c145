//! The hard cases, given to everyone: each contestant and case in a process of its own, because
//! some do not survive.
//!
//! What is counted is rays of which brute force says that they hit a finite triangle, and where the
//! contestant finds nothing, or something else; and rays that hit nothing and do in its eyes.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, ensure};
use bvh_core::{Ray, Triangles, Vec3};
use pivot_benches::embree::Device;
use pivot_benches::{Contest, Entry, Hits, LIMIT, RAYS, Rays, field};
use rt_cpu::{Hit, TriangleTest, closest_hit_brute, uniform};

use crate::progress::Progress;
use crate::{CheckFailed, files, interrupt};

/// Triangles of a case, and rays cast at it.
const TRIANGLES: usize = 4000;
const CAST: usize = 2000;
/// What a contestant is that loses no hit and finds no wrong one.
const FINE: &str = "fine";
/// A case that takes longer hangs.
const PATIENCE: Duration = Duration::from_secs(30);

/// A name, what it is, and positions in each frame; the tree is built over the first.
type Case = (&'static str, &'static str, fn() -> Vec<Vec<Vec3>>);

const CASES: [Case; 8] = [
    ("plain", "nothing wrong with it", || vec![soup(); 2]),
    ("nan-coordinate", "1 % of the triangles with one NaN coordinate from the start", || {
        vec![with(soup(), f32::NAN); 2]
    }),
    ("nan-at-build", "1 % of the triangles all NaN from the start", || vec![without(soup()); 2]),
    ("nan-later", "1 % of the triangles become all NaN after the build", || vec![soup(), without(soup())]),
    ("nan-and-back", "the same, and finite again in the next frame", || {
        vec![soup(), without(soup()), soup()]
    }),
    ("infinite", "1 % of the triangles with an infinite coordinate from the start", || {
        vec![with(soup(), f32::INFINITY); 2]
    }),
    ("identical", "all triangles the same", || {
        vec![[Vec3::ZERO, Vec3::X * 9.0, Vec3::Y * 9.0].repeat(TRIANGLES); 2]
    }),
    (
        "exponential",
        "each triangle 1.4 times as far out, and as large, as the one before, from 1e-9 to 1e9",
        || vec![exponential(); 2],
    ),
];

/// A place in the unit cube for each number.
fn point(i: usize) -> Vec3 {
    Vec3::from([0, 1, 2].map(|axis| uniform(0, (3 * i + axis) as u64)))
}

fn soup() -> Vec<Vec3> {
    (0..3 * TRIANGLES).map(|i| point(i / 3) * 20.0 + point(900_000 + i)).collect()
}

fn with(mut positions: Vec<Vec3>, bad: f32) -> Vec<Vec3> {
    positions.iter_mut().step_by(300).enumerate().for_each(|(i, p)| p[i % 3] = bad);
    positions
}

fn without(mut positions: Vec<Vec3>) -> Vec<Vec3> {
    positions.chunks_mut(3).step_by(100).for_each(|corners| corners.fill(Vec3::NAN));
    positions
}

fn exponential() -> Vec<Vec3> {
    (0..120)
        .flat_map(|i| {
            let x = (i as f32 / 2.0 - 30.0).exp2();
            [Vec3::new(x, -x, -x), Vec3::new(x, x, -x), Vec3::new(x, 0.0, x)]
        })
        .collect()
}

/// Runs every case for everyone and prints a table in Markdown.
pub(super) fn run(embree: Option<&Path>) -> Result<()> {
    let device = super::embree(embree, 1)?;
    let names: Vec<_> = contestants(device.as_ref()).map(|entry| entry.name).collect();
    let progress = Progress::new("hard cases", (names.len() * CASES.len()) as u64);
    let mut lines = vec![
        format!("| contestant | {} |", CASES.map(|case| case.0).join(" | ")),
        format!("|---|{}", "---|".repeat(CASES.len())),
    ];
    let (mut done, mut broken) = (0, Vec::new());
    'all: for name in &names {
        let mut cells = Vec::new();
        for case in CASES {
            let Some(cell) = in_a_process(case.0, name, embree)? else { break 'all };
            cells.push(cell);
            done += 1;
            progress.at(done);
        }
        let is_broken = name.starts_with("pivot ") && cells.iter().any(|cell| cell != FINE);
        broken.extend(is_broken.then_some(name.as_str()));
        lines.push(format!("| {name} | {} |", cells.join(" | ")));
    }
    drop(progress);
    lines.push(String::new());
    lines.extend(CASES.map(|(name, about, _)| format!("- {name}: {about}")));
    files::print(&lines.join("\n"))?;
    ensure!(broken.is_empty(), CheckFailed(format!("hard cases break {}", broken.join(", "))));
    Ok(())
}

/// What a child process says of one case, or how it ended; nothing after an interrupt, which the
/// child gets, too.
fn in_a_process(case: &str, contestant: &str, embree: Option<&Path>) -> Result<Option<String>> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["compare", "hard", "--case", case, "--contestant", contestant]);
    command.args(embree.iter().flat_map(|path| [Path::new("--embree"), path]));
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn()?;
    let start = Instant::now();
    while child.try_wait()?.is_none() && !interrupt::requested() && start.elapsed() <= PATIENCE {
        std::thread::sleep(Duration::from_millis(20));
    }
    let hangs = child.try_wait()?.is_none();
    if hangs {
        child.kill()?;
    }
    let output = child.wait_with_output()?;
    if interrupt::requested() {
        return Ok(None);
    }
    Ok(Some(match output.status.code() {
        _ if hangs => "hangs".to_owned(),
        Some(0) => String::from_utf8(output.stdout)?.trim().to_owned(),
        Some(101) => "panics".to_owned(),
        Some(code) => format!("fails ({code})"),
        None => "crashes".to_owned(),
    }))
}

/// Everyone who updates or rebuilds, and in their robust modes those who have one.
fn contestants(embree: Option<&Device>) -> impl Iterator<Item = Entry> {
    let updates = field(Contest::Update, embree).into_iter().filter(|entry| entry.name != LIMIT);
    let robust = field(Contest::Trace, embree).into_iter().filter(|entry| entry.name.contains("robust"));
    updates.chain(robust)
}

/// One case for one contestant, in this process.
pub(super) fn run_one(case: &str, contestant: &str, embree: Option<&Path>) -> Result<()> {
    let (.., frames) = CASES
        .into_iter()
        .find(|c| c.0 == case)
        .ok_or_else(|| anyhow!("no case '{case}'; there are {}", CASES.map(|case| case.0).join(", ")))?;
    let frames = frames();
    let indices: Vec<[u32; 3]> =
        (0..frames[0].len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let device = super::embree(embree, 1)?;
    let entry = contestants(device.as_ref())
        .find(|entry| entry.name == contestant)
        .ok_or_else(|| anyhow!("no contestant '{contestant}'"))?;
    let mut contestant = entry.make(&Triangles { positions: &frames[0], indices: &indices })?;
    for positions in &frames {
        contestant.pose(positions);
        contestant.update()?;
    }
    let last = frames.last().context("no frames")?;
    let triangles = Triangles { positions: last, indices: &indices };
    let (mut wanted, mut lost, mut wrong) = (0, 0, 0);
    for start in (0..CAST).step_by(RAYS) {
        let (mut rays, mut hits) = (Rays::default(), Hits::default());
        for i in start..(start + RAYS).min(CAST) {
            // At the middle of a triangle, so that rounding at edges decides nothing.
            let target = triangles.corners(i * 7 % indices.len()).iter().sum::<Vec3>() / 3.0;
            let from = Vec3::splat(10.0) + (point(700_000 + i) - 0.5) * 60.0;
            rays.push(from, if target.is_finite() { target - from } else { Vec3::Y }, f32::INFINITY);
        }
        contestant.closest(&rays, &mut hits);
        for i in 0..rays.len() {
            let ray = Ray::new(rays.origin(i), rays.direction(i));
            let t = |hit: Option<Hit>| hit.map_or(f32::INFINITY, |hit| hit.t);
            let same = |a: f32, b: f32| a == b || (a - b).abs() <= 1e-3 * a.min(b).max(1e-3);
            let [expected, others @ ..] =
                [TriangleTest::Double, TriangleTest::Watertight, TriangleTest::MollerTrumbore]
                    .map(|test| closest_hit_brute(&triangles, &ray, f32::INFINITY, test));
            // What single precision cannot decide says nothing about trees.
            if others.iter().any(|&other| !same(t(other), t(expected))) {
                continue;
            }
            wanted += u32::from(expected.is_some());
            match (expected, hits.get(i)) {
                (Some(_), None) => lost += 1,
                (Some(a), Some(b)) => wrong += u32::from(!same(a.t, b.t)),
                (None, Some(_)) => wrong += 1,
                (None, None) => {}
            }
        }
    }
    files::print(&match (lost, wrong) {
        (0, 0) => FINE.to_owned(),
        _ => format!("{lost} of {wanted} lost, {wrong} wrong"),
    })
}
