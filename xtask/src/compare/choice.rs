//! Whether the strategy that chooses has chosen well: beside the best single one on each scene, in whole frames.

use super::row::Row;
use super::table::threads_of;

/// The strategy that chooses.
const CHOOSES: &str = "pivot auto";

/// What it is held to, at most.
const REACH_MEAN: f64 = 1.05;
const REACH_WORST: f64 = 1.1;
const REACH_SAH: f64 = 1.3;
const REACH_EMBREE: f64 = 1.0;

/// The row of least mean time among whole frames of one scene and number of threads: a frame of a loop that has repairs
/// in it is not like the next, so that a median would leave them out.
pub(super) fn best<'a>(rows: &'a [Row], of: &Row, is_meant: impl Fn(&str) -> bool) -> Option<&'a Row> {
    let here = rows.iter().filter(|r| r.what == of.what && r.scene == of.scene && r.threads == of.threads);
    let meant = here.filter(|r| is_meant(&r.contestant) && r.mean_ms > 0.0);
    meant.min_by(|a, b| a.mean_ms.total_cmp(&b.mean_ms))
}

/// A line for each scene and number of threads; nothing where the strategy that chooses has not run.
pub(super) fn table(rows: &[Row]) -> String {
    let mut text = String::new();
    for auto in rows.iter().filter(|r| r.what == "frame" && r.contestant == CHOOSES) {
        let single = best(rows, auto, |name| name.starts_with("pivot ") && name != CHOOSES);
        let embree = best(rows, auto, |name| name.starts_with("embree "));
        let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.3}"));
        let name = |row: Option<&Row>| {
            row.and_then(|r| r.contestant.split_once(' ')).map_or("-", |(_, name)| name).to_owned()
        };
        text += &format!(
            "\n  {:<18} {:<10} {:<24} {:>10} {:>10} {:>10}  {:<22} {:>10}",
            auto.scene,
            threads_of(auto.threads),
            name(single),
            number(single.map(|best| auto.mean_ms / best.mean_ms)),
            number(single.map(|best| auto.max_ms / best.max_ms)),
            number(auto.worst_sah_over_sweep),
            name(embree),
            number(embree.map(|best| auto.mean_ms / best.mean_ms)),
        );
    }
    if text.is_empty() {
        return text;
    }
    let reach = [REACH_MEAN, REACH_WORST, REACH_SAH, REACH_EMBREE].map(|reach| format!("<= {reach}"));
    format!(
        "\nauto, whole frames, over the best single strategy and over Embree's best\n  \
         {:<18} {:<10} {:<24} {:>10} {:>10} {:>10}  {:<22} {:>10}\n  \
         {:<54} {:>10} {:>10} {:>10}  {:<22} {:>10}{text}\n",
        "scene",
        "",
        "best single",
        "mean",
        "worst",
        "worst SAH",
        "Embree's best",
        "mean",
        "reach",
        reach[0],
        reach[1],
        reach[2],
        "",
        reach[3],
    )
}

#[cfg(test)]
mod tests {
    use super::super::row::Record;
    use super::*;

    fn row(contestant: &str, times_ms: &[f64]) -> Row {
        let record = Record { times_ms: times_ms.to_vec(), costs: vec![1.1, 1.2], ..Record::default() };
        record.row("frame", "scene", 100, contestant, 1, &record.answers)
    }

    #[test]
    fn the_best_by_mean_time_is_what_counts() {
        let rows = [
            row("pivot refit", &[10.0, 10.0, 40.0]),
            row("pivot ploc", &[16.0, 16.0, 16.0]),
            row("embree low, single", &[32.0, 32.0, 32.0]),
            row(CHOOSES, &[16.0, 16.0, 20.0]),
        ];
        let text = table(&rows);
        let words: Vec<_> = text.lines().last().expect("a line").split_whitespace().collect();
        assert_eq!(
            words,
            ["scene", "1", "thread", "ploc", "1.083", "1.250", "1.200", "low,", "single", "0.542"]
        );
        assert_eq!(table(&rows[..3]), "");
    }
}
