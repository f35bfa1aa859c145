//! Results as text.

use super::row::Row;

/// Rows of one measurement; first the figure that can be compared between scenes: nanoseconds a
/// triangle, or rays a second.
pub(super) fn table(rows: &[Row]) -> String {
    let Some(first) = rows.first() else { return String::new() };
    let what = if first.what == "limit" { "update" } else { first.what.as_str() };
    let threads =
        if first.threads == 1 { "1 thread".to_owned() } else { format!("{} threads", first.threads) };
    let unit = if first.million_rays_per_s.is_some() { "Mrays/s" } else { "ns/tri" };
    let mut text = format!(
        "\n{what}, {}, {} triangles, {threads}, median of {} frames\n",
        first.scene, first.triangles, first.frames
    );
    text += &format!(
        "  {:<30} {unit:>8} {:>10} {:>10} {:>10} {:>10} {:>10} {:>8} {:>10} {:>9}\n",
        "", "median ms", "min", "max", "mean", "its update", "SAH", "hits", "different"
    );
    for row in rows {
        let figure = row.million_rays_per_s.unwrap_or(row.ns_per_triangle);
        let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.3}"));
        let (cost, update) = (number(row.sah_over_sweep), number(row.mean_update_ms));
        let hits = if row.what == "limit" { "-".to_owned() } else { row.hits.to_string() };
        let remark = if row.agrees { "" } else { "  NOT THE SAME HITS" };
        text += &format!(
            "  {:<30} {figure:>8.1} {:>10.3} {:>10.3} {:>10.3} {:>10.3} {update:>10} {cost:>8} {hits:>10} {:>9}{remark}\n",
            row.contestant, row.median_ms, row.min_ms, row.max_ms, row.mean_ms, row.different
        );
    }
    text.trim_end().to_owned()
}

/// A number of threads in words.
pub(super) fn threads_of(threads: usize) -> String {
    format!("{threads} thread{}", if threads == 1 { "" } else { "s" })
}
