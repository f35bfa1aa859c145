//! Rows of measurements, written to CSV files as they are made.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize, Serializer};

use crate::files;

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
    #[serde(serialize_with = "microseconds")]
    pub(crate) animate_ms: f64,
    #[serde(serialize_with = "microseconds")]
    pub(crate) update_ms: f64,
    #[serde(serialize_with = "microseconds")]
    pub(crate) trace_ms: f64,
    /// Update and trace.
    #[serde(serialize_with = "microseconds")]
    pub(crate) frame_ms: f64,
    pub(crate) sah_cost: f64,
    pub(crate) rotations: u64,
    pub(crate) height: u32,
    pub(crate) nodes_visited: u64,
    pub(crate) rays_primary: u64,
    pub(crate) rays_shadow: u64,
    pub(crate) hits: u64,
    /// Primitives without finite coordinates, as far as the update visited them.
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
    #[serde(serialize_with = "microseconds")]
    pub(crate) blend_ms: f64,
    #[serde(serialize_with = "microseconds")]
    pub(crate) morph_ms: f64,
    #[serde(serialize_with = "microseconds")]
    pub(crate) skin_ms: f64,
    #[serde(serialize_with = "microseconds")]
    pub(crate) rigid_ms: f64,
    /// Primitives whose boxes the update asked for.
    pub(crate) primitives_refit: u64,
    /// What the update decided to do, in words without commas; `as always` for what does the same every time.
    #[serde(default)]
    pub(crate) decision: String,
}

/// Milliseconds, written to a tenth of a microsecond.
fn microseconds<S: Serializer>(ms: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_f64((ms * 1e4).round() / 1e4)
}

/// A CSV file that holds every row it was given, whatever happens next.
pub(crate) struct Records {
    path: PathBuf,
    writer: csv::Writer<File>,
}

impl Records {
    /// A file with a header and the rows that an earlier run has left.
    pub(crate) fn create(path: &Path, kept: &[Row]) -> Result<Self> {
        let mut start = csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new());
        start.write_record(COLUMNS)?;
        kept.iter().try_for_each(|row| start.serialize(row))?;
        files::write_whole(path, &start.into_inner()?)?;
        let file = File::options().append(true).open(path);
        let file = file.with_context(|| format!("{}: cannot be written", path.display()))?;
        let writer = csv::WriterBuilder::new().has_headers(false).from_writer(file);
        Ok(Self { path: path.to_owned(), writer })
    }

    /// Appends the rows of a frame.
    pub(crate) fn append(&mut self, rows: &[Row]) -> Result<()> {
        for row in rows {
            self.writer
                .serialize(row)
                .with_context(|| format!("{}: cannot be written", self.path.display()))?;
        }
        self.flush()
    }

    fn flush(&mut self) -> Result<()> {
        self.writer.flush().with_context(|| format!("{}: cannot be written", self.path.display()))
    }
}

/// The rows of a file, none if there is no such file. What an interrupt cut off at its end is left out.
pub(crate) fn read(path: &Path) -> Result<Vec<Row>> {
    let text = match fs::read_to_string(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        text => text.with_context(|| format!("{}: cannot be read", path.display()))?,
    };
    let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
    let rows: Result<_, _> = csv::Reader::from_reader(whole.as_bytes()).into_deserialize().collect();
    rows.with_context(|| format!("{}: not rows of this program", path.display()))
}

/// The columns, in order.
const COLUMNS: [&str; 29] = [
    "scene",
    "strategy",
    "threads",
    "loop",
    "frame",
    "animate_ms",
    "update_ms",
    "trace_ms",
    "frame_ms",
    "sah_cost",
    "rotations",
    "height",
    "nodes_visited",
    "rays_primary",
    "rays_shadow",
    "hits",
    "dropped",
    "frames_per_loop",
    "time_s",
    "vertices_blended",
    "vertices_morphed",
    "vertices_skinned",
    "vertices_rigid",
    "blend_ms",
    "morph_ms",
    "skin_ms",
    "rigid_ms",
    "primitives_refit",
    "decision",
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_as_they_were_and_torn_ones_do_not() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("frames.csv");
        assert_eq!(read(&path).unwrap(), []);
        let row = |frame| Row {
            scene: "a, b".to_owned(),
            strategy: "auto".to_owned(),
            frame,
            update_ms: 0.125,
            sah_cost: 1.0 / 3.0,
            decision: "built anew".to_owned(),
            ..Row::default()
        };
        Records::create(&path, &[row(0)]).unwrap().append(&[row(1), row(2)]).unwrap();
        assert_eq!(read(&path).unwrap(), [row(0), row(1), row(2)]);
        let text = fs::read_to_string(&path).unwrap();
        assert_eq!(text.lines().next().unwrap(), COLUMNS.join(","));
        fs::write(&path, &text[..text.len() - 9]).unwrap();
        assert_eq!(read(&path).unwrap(), [row(0), row(1)]);
        fs::write(&path, "scene,strategy\n1,2\n").unwrap();
        assert!(read(&path).is_err());
    }
}
