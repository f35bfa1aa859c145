//! The ratios that tell how far this project has got: everything in one run, so that the machine cancels out.

use super::choice::best;
use super::lane::SET_UP;
use super::row::Row;
use super::table::threads_of;

/// Time of one contestant over that of another on the same scene.
struct Ratio {
    title: &'static str,
    over: [&'static str; 2],
    under: [&'static str; 2],
    /// What is aimed at, at most, if anything is.
    reach: Option<f64>,
}

const fn ratio(title: &'static str, over: [&'static str; 2], under: [&'static str; 2], reach: f64) -> Ratio {
    Ratio { reach: Some(reach), ..known(title, over, under) }
}

/// One that stands there to be known.
const fn known(title: &'static str, over: [&'static str; 2], under: [&'static str; 2]) -> Ratio {
    Ratio { title, over, under, reach: None }
}

const WIDE: [&str; 2] = ["incoherent", "pivot wide"];
const TRACE_AVX512: [&str; 2] = ["trace", "pivot avx512"];
const TRACE_AVX2: [&str; 2] = ["trace", "pivot avx2"];
const TRACE_4: [&str; 2] = ["trace", "pivot leaves of 4"];
const REFIT: [&str; 2] = ["update", "pivot refit"];
const ROTATE: [&str; 2] = ["update", "pivot refit+rotate"];

// With leaves as others have them, of two triangles where that is no worse a tree.
const REFIT_2: [&str; 2] = ["update", "pivot refit, leaves of 2"];
const ROTATE_2: [&str; 2] = ["update", "pivot refit+rotate, leaves of 2"];

const RATIOS: [Ratio; 27] = [
    ratio("refit / memory limit", REFIT, ["limit", "memory limit"], 2.2),
    ratio("refit / Embree refit", REFIT, ["update", "embree refit"], 1.0),
    ratio("refit+rotate / refit", ROTATE, REFIT, 1.8),
    ratio("refit+rotate / Embree low", ROTATE, ["update", "embree low"], 0.3),
    ratio("refit+rotate / obvhs refit", ROTATE, ["update", "obvhs refit"], 1.0),
    ratio("refit, leaves of 2 / memory limit", REFIT_2, ["limit", "memory limit"], 2.2),
    ratio("refit, leaves of 2 / Embree refit", REFIT_2, ["update", "embree refit"], 1.0),
    ratio("refit+rotate, leaves of 2 / refit, the same", ROTATE_2, REFIT_2, 1.8),
    ratio("refit+rotate, leaves of 2 / Embree low", ROTATE_2, ["update", "embree low"], 0.3),
    ratio("refit+rotate, leaves of 2 / obvhs refit", ROTATE_2, ["update", "obvhs refit"], 1.0),
    ratio("refit+rotate+regrow / refit+rotate", ["update", "pivot refit+rotate+regrow"], ROTATE, 2.0),
    ratio("lbvh / Embree low", ["update", "pivot lbvh"], ["update", "embree low"], 1.0),
    ratio("ploc / Embree low", ["update", "pivot ploc"], ["update", "embree low"], 1.0),
    ratio("binned-parallel / obvhs fast", ["build", "pivot binned-parallel"], ["build", "obvhs fast"], 1.0),
    ratio("trace, avx512 / Embree 16", TRACE_AVX512, ["trace", "embree packets of 16"], 1.0),
    ratio("trace, avx2 / Embree 16", TRACE_AVX2, ["trace", "embree packets of 16"], 1.2),
    // At the best level of the machine.
    known("trace, leaves of 4 / Embree 16", TRACE_4, ["trace", "embree packets of 16"]),
    known("trace, leaves of 4 / Embree 8", TRACE_4, ["trace", "embree packets of 8"]),
    // Without AVX-512, Embree's packets of 16 are no match for its packets of 8.
    ratio("trace, avx2 / Embree 8", TRACE_AVX2, ["trace", "embree packets of 8"], 1.2),
    ratio("trace, avx2 / Embree 8, avx2", TRACE_AVX2, ["trace", "embree packets of 8, avx2"], 1.2),
    // Of single rays only those that have little in common are aimed at.
    known("trace, single / Embree single", ["trace", "pivot single"], ["trace", "embree single"]),
    known("trace, wide / Embree single", ["trace", "pivot wide"], ["trace", "embree single"]),
    ratio("incoherent, wide / Embree single", WIDE, ["incoherent", "embree single"], 1.8),
    ratio("incoherent, wide / Embree robust", WIDE, ["incoherent", "embree single, robust"], 1.8),
    ratio(
        "incoherent, single / Embree single",
        ["incoherent", "pivot single"],
        ["incoherent", "embree single"],
        1.8,
    ),
    ratio("incoherent, wide / obvhs cwbvh", WIDE, ["incoherent", "obvhs cwbvh"], 1.0),
    ratio(
        "incoherent, single / obvhs binary",
        ["incoherent", "pivot single"],
        ["incoherent", "obvhs binary"],
        1.0,
    ),
];

/// What threads are meant to speed up, and by how much two of them.
const SCALES: [([&str; 2], f64); 7] = [
    (["limit", "memory limit"], 1.8),
    (REFIT, 1.8),
    (ROTATE, 1.8),
    (["build", "pivot binned-parallel"], 1.8),
    (TRACE_AVX2, 1.9),
    (TRACE_AVX512, 1.9),
    (WIDE, 1.9),
];

/// Growth of the time a triangle from the smallest scene to the largest.
const GROWTH: ([[&str; 2]; 3], f64) = ([["limit", "memory limit"], REFIT, ROTATE], 1.5);

fn find<'a>(rows: &'a [Row], key: [&str; 2], scene: &str, threads: usize) -> Option<&'a Row> {
    rows.iter().find(|r| [r.what, &r.contestant] == key && r.scene == scene && r.threads == threads)
}

/// Whole frames, by their means, over the best that Embree can do, whatever its quality and ray width.
const FRAMES: [(&str, f64); 2] = [("pivot refit+rotate", 1.0), ("pivot auto", 1.0)];

/// All ratios that the rows allow, a line each, a column for each scene.
pub(super) fn table(rows: &[Row]) -> String {
    let mut scenes: Vec<&str> = Vec::new();
    let mut threads: Vec<usize> = Vec::new();
    for row in rows {
        if !scenes.contains(&row.scene.as_str()) {
            scenes.push(&row.scene);
        }
        if !threads.contains(&row.threads) {
            threads.push(row.threads);
        }
    }
    let mut lines = Vec::new();
    let mut line = |title: String, values: Vec<Option<f64>>, reach: String| {
        if values.iter().any(Option::is_some) {
            let cells =
                values.iter().map(|v| v.map_or_else(|| format!("{:>18}", "-"), |v| format!("{v:>18.2}")));
            lines.push(format!("  {title:<52}{} {reach:>10}", cells.collect::<String>()));
        }
    };
    for &n in &threads {
        for Ratio { title, over, under, reach } in &RATIOS {
            let reach = reach.map_or_else(String::new, |reach| format!("<= {reach}"));
            let value = |scene: &&str| {
                let (over, under) = (find(rows, *over, scene, n)?, find(rows, *under, scene, n)?);
                (under.median_ms > 0.0).then(|| over.median_ms / under.median_ms)
            };
            line(format!("{title}, {}", threads_of(n)), scenes.iter().map(value).collect(), reach.clone());
            // What users of others do themselves, taken off their time alone.
            let value = |scene: &&str| {
                let (over, under) = (find(rows, *over, scene, n)?, find(rows, *under, scene, n)?);
                let under = under.median_ms - find(rows, [under.what, SET_UP], scene, n)?.median_ms;
                (under > 0.0).then(|| over.median_ms / under)
            };
            let title = format!("  less ray set-up, {}", threads_of(n));
            line(title, scenes.iter().map(value).collect(), reach);
        }
        let is_embree = |name: &str| name.starts_with("embree ");
        for (contestant, reach) in FRAMES {
            let value = |scene: &&str| {
                let ours = find(rows, ["frame", contestant], scene, n)?;
                Some(ours.mean_ms / best(rows, ours, is_embree)?.mean_ms)
            };
            let title = format!("frame (means), {contestant} / Embree's best, {}", threads_of(n));
            line(title, scenes.iter().map(value).collect(), format!("<= {reach}"));
            let value = |scene: &&str| {
                let ours = find(rows, ["frame", contestant], scene, n)?;
                let set_up = find(rows, ["frame", SET_UP], scene, n)?.mean_ms;
                let best = best(rows, ours, is_embree)?.mean_ms - set_up;
                (best > 0.0).then(|| ours.mean_ms / best)
            };
            let title = format!("  less ray set-up, {}", threads_of(n));
            line(title, scenes.iter().map(value).collect(), format!("<= {reach}"));
        }
    }
    for &n in threads.iter().filter(|&&n| n > 1) {
        for (key, reach) in SCALES {
            let value = |scene: &&str| {
                let (one, many) = (find(rows, key, scene, 1)?, find(rows, key, scene, n)?);
                (many.median_ms > 0.0).then(|| one.median_ms / many.median_ms)
            };
            let reach = if n == 2 { format!(">= {reach}") } else { String::new() };
            let title = format!("{} {}, {n} threads faster than 1 by", key[0], key[1]);
            line(title, scenes.iter().map(value).collect(), reach);
        }
    }
    let mut text = String::new();
    if !lines.is_empty() {
        let heads: String = scenes.iter().map(|s| format!("{s:>18}")).collect();
        text = format!("\n  {:<52}{heads} {:>10}\n{}", "ratios of medians", "reach", lines.join("\n"));
    }
    text + &growth(rows, &threads)
}

fn growth(rows: &[Row], threads: &[usize]) -> String {
    let (keys, reach) = GROWTH;
    let mut text = String::new();
    for &n in threads {
        for key in keys {
            let all = || rows.iter().filter(|r| [r.what, &r.contestant] == key && r.threads == n);
            let (Some(small), Some(large)) =
                (all().min_by_key(|r| r.triangles), all().max_by_key(|r| r.triangles))
            else {
                continue;
            };
            if small.triangles < large.triangles && small.ns_per_triangle > 0.0 {
                text += &format!(
                    "\n  {}, {}: ns per triangle at {} over that at {}: {:.2} (reach <= {reach})",
                    key[1],
                    threads_of(n),
                    large.triangles,
                    small.triangles,
                    large.ns_per_triangle / small.ns_per_triangle
                );
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::row::Record;
    use super::*;

    fn row(key: [&'static str; 2], scene: &str, triangles: usize, threads: usize, ms: f64) -> Row {
        let record = Record { times_ms: vec![ms], ..Record::default() };
        record.row(key[0], scene, triangles, key[1], threads, &record.answers)
    }

    #[test]
    fn ratios_compare_rows_of_the_same_scene_and_threads() {
        let rows = [
            row(REFIT, "small", 100, 1, 2.0),
            row(REFIT, "small", 100, 2, 1.0),
            row(ROTATE, "small", 100, 1, 3.0),
            row(REFIT, "large", 1000, 1, 30.0),
            row(["update", "embree refit"], "large", 1000, 1, 60.0),
            row(["trace", "pivot single"], "small", 100, 1, 3.0),
            row(["trace", "embree single"], "small", 100, 1, 1.0),
            row(["incoherent", "pivot single"], "small", 100, 1, 3.0),
            row(["incoherent", "embree single"], "small", 100, 1, 1.0),
        ];
        let text = table(&rows);
        let line = |start: &str| text.lines().find(|l| l.trim().starts_with(start)).expect(start).to_owned();
        assert!(line("refit+rotate / refit, 1").contains("1.50"));
        assert!(line("refit / Embree refit, 1").contains("0.50"));
        assert!(line("update pivot refit, 2 threads faster").contains("2.00"));
        assert!(line("pivot refit, 1 thread: ns").contains("1.50"));
        assert!(!text.contains("Embree low"));
        assert!(line("trace, single / Embree single, 1").contains("3.00"));
        assert!(!line("trace, single / Embree single, 1").contains("<="));
        assert!(line("incoherent, single / Embree single, 1").contains("<= 1.8"));
        assert_eq!(table(&[]), "");
    }

    #[test]
    fn whole_frames_are_compared_by_their_means() {
        let row = |contestant: &str, times_ms: &[f64]| {
            let record = Record { times_ms: times_ms.to_vec(), ..Record::default() };
            record.row("frame", "scene", 100, contestant, 1, &record.answers)
        };
        let rows = [
            row("pivot refit+rotate", &[3.0, 3.0, 6.0]),
            // The less by its median, the more by its mean.
            row("embree low, single", &[2.0, 2.0, 20.0]),
            row("embree refit, single", &[5.0, 5.0, 5.0]),
            row(SET_UP, &[1.0, 1.0, 1.0]),
        ];
        let text = table(&rows);
        assert!(text.contains("Embree's best") && text.contains("0.80") && text.contains("1.00"), "{text}");
    }
}
