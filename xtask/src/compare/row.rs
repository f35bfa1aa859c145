//! The rows of the result file.

use anyhow::Result;
use pivot_benches::Answers;
use serde::Serialize;

use crate::machine::{Machine, Revision};

/// One contestant on one scene with one number of threads.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Row {
    /// `update`, `limit`, `build`, `trace`, `incoherent`, `view` (making the wide view for that) or `frame`.
    pub(crate) what: &'static str,
    pub(crate) scene: String,
    pub(crate) triangles: usize,
    pub(crate) contestant: String,
    pub(crate) threads: usize,
    pub(crate) median_ms: f64,
    pub(crate) min_ms: f64,
    pub(crate) max_ms: f64,
    /// Tells more than the median of updates that do not do the same work in every frame.
    pub(crate) mean_ms: f64,
    /// Of whole frames: the mean of what the update took.
    pub(crate) mean_update_ms: Option<f64>,
    /// Mean over the measured frames of the tree's SAH cost over that of a full sweep build of the same frame;
    /// nothing where the tree cannot be read.
    pub(crate) sah_over_sweep: Option<f64>,
    /// The same in the frame where it is worst.
    pub(crate) worst_sah_over_sweep: Option<f64>,
    /// Primary rays that hit something, in all measured frames of all runs.
    pub(crate) hits: u64,
    /// The median over the number of triangles.
    pub(crate) ns_per_triangle: f64,
    /// Of tracing: primary and shadow rays over the median time.
    pub(crate) million_rays_per_s: Option<f64>,
    /// Measured frames; of several runs their medians.
    pub(crate) frames: usize,
    /// Primary rays cast for comparison.
    pub(crate) rays: u64,
    /// Pixels that the light reaches.
    pub(crate) lit: u64,
    /// Sum of the distances of all hits.
    pub(crate) t_sum: f64,
    /// Primary rays with another answer than the reference: hit or miss, or a distance off by more than 0.1 %.
    pub(crate) different: u64,
    /// Whether the number of hits is the reference's within 0.01 %.
    pub(crate) agrees: bool,
    /// Nodes that rays opened, nodes that updates visited, primitives built anew, over all frames.
    pub(crate) work: [u64; 3],
}

impl Row {
    /// Where a row belongs, for messages.
    pub(super) fn place(&self) -> String {
        let Self { what, scene, contestant, threads, different, rays, .. } = self;
        format!("{what} of {scene}, {contestant}, {threads} threads ({different} of {rays} rays)")
    }
}

/// What a contestant did on a scene.
#[derive(Clone, Debug, Default)]
pub(super) struct Record {
    /// Times of the measured frames.
    pub(super) times_ms: Vec<f64>,
    /// Of whole frames: the part of these that the update took.
    pub(super) updates_ms: Vec<f64>,
    /// Ratios of cost of the same frames.
    pub(super) costs: Vec<f64>,
    pub(super) answers: Answers,
}

impl Record {
    /// The row, compared to what the reference found.
    pub(super) fn row(
        &self,
        what: &'static str,
        scene: &str,
        triangles: usize,
        contestant: &str,
        threads: usize,
        reference: &Answers,
    ) -> Row {
        let mut sorted = self.times_ms.clone();
        sorted.sort_by(f64::total_cmp);
        let median_ms = median(&sorted);
        let costs = &self.costs;
        Row {
            what,
            scene: scene.to_owned(),
            triangles,
            contestant: contestant.to_owned(),
            threads,
            median_ms,
            min_ms: sorted.first().copied().unwrap_or_default(),
            max_ms: sorted.last().copied().unwrap_or_default(),
            mean_ms: mean(&sorted).unwrap_or_default(),
            mean_update_ms: mean(&self.updates_ms),
            sah_over_sweep: mean(costs),
            worst_sah_over_sweep: costs.iter().copied().reduce(f64::max),
            hits: self.answers.hits,
            ns_per_triangle: median_ms * 1e6 / triangles as f64,
            million_rays_per_s: None,
            frames: sorted.len(),
            rays: self.answers.rays,
            lit: self.answers.lit,
            t_sum: self.answers.t_sum,
            different: self.answers.different,
            agrees: self.answers.agrees_with(reference),
            work: [0; 3],
        }
    }
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Median of sorted values; 0 if there are none.
pub(super) fn median(sorted: &[f64]) -> f64 {
    match sorted.len() {
        0 => 0.0,
        n if n % 2 == 1 => sorted[n / 2],
        n => 0.5 * (sorted[n / 2 - 1] + sorted[n / 2]),
    }
}

/// Everything that was measured.
#[derive(Clone, Debug)]
pub(super) struct Report {
    machine: Machine,
    revision: Revision,
    /// Version of Embree, where it took part.
    embree: Option<String>,
    pub(super) rows: Vec<Row>,
}

/// The machine, and the versions of what ran on it.
#[derive(Serialize)]
struct On<'a> {
    #[serde(flatten)]
    machine: &'a Machine,
    #[serde(flatten)]
    revision: &'a Revision,
    embree: Option<&'a str>,
}

#[derive(Serialize)]
struct File<'a> {
    machine: On<'a>,
    rows: &'a [Row],
}

impl Report {
    pub(super) fn new(machine: Machine, revision: Revision, embree: Option<String>) -> Self {
        Self { machine, revision, embree, rows: Vec::new() }
    }

    /// The result file.
    pub(super) fn json(&self) -> Result<Vec<u8>> {
        let Self { machine, revision, embree, rows } = self;
        let machine = On { machine, revision, embree: embree.as_deref() };
        Ok(serde_json::to_vec_pretty(&File { machine, rows })?)
    }

    /// One line on what ran where.
    pub(super) fn heading(&self) -> String {
        let Machine { cpu, cores, simd, load, .. } = &self.machine;
        let load = load.map(|l| format!(", load {l:.1}")).unwrap_or_default();
        let embree = self.embree.as_ref().map(|v| format!(", Embree {v}")).unwrap_or_default();
        format!("{cpu}, {cores} cores, {simd}{load}; Pivot {}{embree}", self.revision.short())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_have_the_columns_that_others_rely_on() {
        let record =
            Record { times_ms: vec![4.0, 1.0, 2.0, 3.0], costs: vec![1.0, 2.0], ..Record::default() };
        let row = record.row("update", "cloth", 1000, "pivot refit", 2, &Answers::default());
        assert_eq!((row.median_ms, row.min_ms, row.max_ms), (2.5, 1.0, 4.0));
        assert_eq!((row.ns_per_triangle, row.sah_over_sweep), (2500.0, Some(1.5)));
        assert_eq!(row.worst_sah_over_sweep, Some(2.0));
        let mut report = Report::new(Machine::read(), Revision::read(), None);
        report.rows.push(row);
        let file: serde_json::Value = serde_json::from_slice(&report.json().expect("written")).expect("read");
        assert!(file["machine"]["cpu"].is_string());
        for column in ["what", "scene", "triangles", "contestant", "threads", "median_ms", "min_ms", "max_ms"]
        {
            assert!(!file["rows"][0][column].is_null(), "{column}");
        }
        assert_eq!(file["rows"][0]["sah_over_sweep"], 1.5);
        assert_eq!(file["rows"][0]["hits"], 0);
    }

    #[test]
    fn rows_tell_when_hits_are_missing() {
        let reference = Answers { rays: 20_000, hits: 20_000, ..Answers::default() };
        let row = |hits| {
            let record = Record { answers: Answers { hits, ..reference }, ..Record::default() };
            record.row("update", "s", 1, "c", 1, &reference).agrees
        };
        assert!(row(19_998) && !row(19_990));
    }
}
