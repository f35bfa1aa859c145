//! One setting of a knob with its error and its time, and the file of them.

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

/// One error of one setting. The names and the order of the columns are relied on by scripts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Point {
    pub(crate) scene: String,
    /// The knob, and after "at" the condition, where there are several.
    pub(crate) knob: String,
    pub(crate) setting: String,
    pub(crate) is_default: bool,
    pub(crate) error_name: String,
    pub(crate) error: f64,
    pub(crate) unit: String,
    pub(crate) time_ms: f64,
    /// What was timed, and what else there is to say.
    pub(crate) note: String,
    /// Memory that the setting takes, where that is what it costs.
    pub(crate) bytes: Option<u64>,
}

/// The points of a file, none if there is no such file. What an interrupt cut off at its end is left out.
pub(crate) fn read(path: &Path) -> Result<Vec<Point>> {
    if !path.exists() {
        return Ok(Vec::new());
    }
    let text =
        std::fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
    let points: Result<_, _> = csv::Reader::from_reader(whole.as_bytes()).into_deserialize().collect();
    points.with_context(|| format!("{}: not points of this program", path.display()))
}

const COLUMNS: [&str; 10] =
    ["scene", "knob", "setting", "is_default", "error_name", "error", "unit", "time_ms", "note", "bytes"];

/// A CSV file that holds every point it was given, whatever happens next.
pub(crate) struct Log {
    path: PathBuf,
    writer: csv::Writer<File>,
}

impl Log {
    /// An empty file with a header.
    pub(crate) fn create(path: &Path) -> Result<Self> {
        let file = File::create(path).with_context(|| format!("{}: cannot be written", path.display()))?;
        let mut writer = csv::WriterBuilder::new().has_headers(false).from_writer(file);
        writer.write_record(COLUMNS)?;
        let mut log = Self { path: path.to_owned(), writer };
        log.flush()?;
        Ok(log)
    }

    pub(crate) fn append(&mut self, point: &Point) -> Result<()> {
        self.writer
            .serialize(point)
            .with_context(|| format!("{}: cannot be written", self.path.display()))?;
        self.flush()
    }

    fn flush(&mut self) -> Result<()> {
        self.writer.flush().with_context(|| format!("{}: cannot be written", self.path.display()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_come_back_from_the_file_as_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("accuracy.csv");
        let mut log = Log::create(&path).unwrap();
        let point = |error, bytes| Point {
            knob: "triangle test at 1e3".to_owned(),
            note: "with \"quotes\", commas".to_owned(),
            is_default: true,
            error,
            bytes,
            ..Point::default()
        };
        let points = [point(0.1, None), point(1e-300, Some(12))];
        points.iter().for_each(|point| log.append(point).unwrap());
        let mut reader = csv::Reader::from_path(path).unwrap();
        let back: Vec<Point> = reader.deserialize().collect::<Result<_, _>>().unwrap();
        assert_eq!(back, points);
    }
}
