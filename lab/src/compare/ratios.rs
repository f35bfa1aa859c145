//! Ratios of times within one run, where the state of the machine cancels out.

use super::row::Row;
use super::table::threads_of;

/// What is measured, one contestant over another; `*` stands for the best of all others whose names
/// begin so.
const RATIOS: [[&str; 3]; 19] = [
    ["update", "pivot refit", "memory limit"],
    ["update", "pivot refit", "embree refit"],
    ["update", "pivot refit", "obvhs refit"],
    ["update", "pivot refit+rotate", "pivot refit"],
    ["update", "pivot refit+rotate", "embree low"],
    ["update", "pivot refit+rotate+regrow", "pivot refit+rotate"],
    ["update", "pivot lbvh", "embree low"],
    ["update", "pivot ploc", "embree low"],
    ["build", "pivot binned-parallel", "obvhs fast"],
    ["trace", "pivot avx512", "embree packets of 16"],
    ["trace", "pivot avx2", "embree packets of 8, avx2"],
    ["trace", "pivot leaves of 4", "embree packets of 16"],
    ["incoherent", "pivot wide", "embree single"],
    ["incoherent", "pivot single", "embree single"],
    ["incoherent", "pivot wide", "obvhs cwbvh"],
    ["incoherent", "pivot single", "obvhs binary"],
    ["frame", "pivot refit+rotate", "embree *"],
    ["frame", "pivot auto", "embree *"],
    ["frame", "pivot auto", "pivot *"],
];

/// Means of whole frames, since repairs make a median leave out what they cost; medians of all
/// else.
fn time(row: &Row) -> f64 {
    if row.what == "frame" { row.mean_ms } else { row.median_ms }
}

/// All ratios that the rows allow, a line each, a column for each scene.
pub(super) fn table(rows: &[Row]) -> String {
    let (mut scenes, mut threads): (Vec<&str>, Vec<usize>) = (Vec::new(), Vec::new());
    for row in rows {
        if !scenes.contains(&row.scene.as_str()) {
            scenes.push(&row.scene);
        }
        if !threads.contains(&row.threads) {
            threads.push(row.threads);
        }
    }
    let mut text = String::new();
    for n in threads {
        for [what, over, under] in RATIOS {
            let value = |scene: &str| {
                let here =
                    || rows.iter().filter(|row| row.scene == scene && row.threads == n && time(row) > 0.0);
                let ours = here().find(|row| row.what == what && row.contestant == over)?;
                let is_meant = |row: &&Row| match under.strip_suffix('*') {
                    Some(start) => {
                        row.what == what && row.contestant != over && row.contestant.starts_with(start)
                    }
                    None => (row.what == what || row.what == "limit") && row.contestant == under,
                };
                let theirs = here().filter(is_meant).map(time).min_by(f64::total_cmp)?;
                Some(time(ours) / theirs)
            };
            let values: Vec<Option<f64>> = scenes.iter().map(|scene| value(scene)).collect();
            if values.iter().any(Option::is_some) {
                let cell =
                    |v: &Option<f64>| v.map_or_else(|| format!("{:>18}", "-"), |v| format!("{v:>18.2}"));
                let cells: String = values.iter().map(cell).collect();
                let title =
                    format!("{what}, {over} / {}, {}", under.replace('*', "best of the rest"), threads_of(n));
                text += &format!("\n  {title:<66}{cells}");
            }
        }
    }
    if text.is_empty() {
        return text;
    }
    let heads: String = scenes.iter().map(|scene| format!("{scene:>18}")).collect();
    format!("\n  {:<66}{heads}{text}\n", "ratios of times")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_of_the_rest_is_the_fastest_other_of_that_name() {
        let row = |contestant: &str, mean_ms: f64| Row {
            scene: "n-body".to_owned(),
            what: "frame".to_owned(),
            contestant: contestant.to_owned(),
            threads: 1,
            mean_ms,
            ..Row::default()
        };
        let rows = [
            row("pivot auto", 3.0),
            row("pivot refit", 4.0),
            row("embree low", 2.0),
            row("embree refit", 6.0),
        ];
        let text = table(&rows);
        let ratios: Vec<_> = text.lines().skip(2).filter_map(|line| line.split_whitespace().last()).collect();
        assert_eq!(ratios, ["1.50", "0.75"], "{text}");
        assert_eq!(table(&[]), "");
    }
}
