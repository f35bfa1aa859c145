//! CSV files that are written row by row and keep every row they were given, whatever happens next.

use std::fs::{self, File};
use std::io::Write;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::files;

/// A file that rows are appended to; the names of their fields are the columns.
pub(crate) struct Journal<T> {
    path: PathBuf,
    file: File,
    /// Bytes of whole rows in the file.
    length: u64,
    of: PhantomData<T>,
}

impl<T: Serialize + Default> Journal<T> {
    /// A file with a header and the rows that an earlier run has left, in place of any that is
    /// there.
    pub(crate) fn create(path: &Path, kept: &[T]) -> Result<Self> {
        let mut example = csv::Writer::from_writer(Vec::new());
        example.serialize(T::default())?;
        let mut start = example.into_inner()?;
        start.truncate(start.iter().position(|&byte| byte == b'\n').map_or(0, |end| end + 1));
        start.extend(lines(kept)?);
        files::write_whole(path, &start)?;
        let file = File::options().append(true).open(path);
        let file = file.with_context(|| format!("{}: cannot be written", path.display()))?;
        Ok(Self { path: path.to_owned(), file, length: start.len() as u64, of: PhantomData })
    }

    /// The same if it is wanted; otherwise removes the file of an earlier run.
    pub(crate) fn if_wanted(wanted: bool, path: &Path, kept: &[T]) -> Result<Option<Self>> {
        if wanted { Self::create(path, kept).map(Some) } else { files::remove_old(path).map(|()| None) }
    }

    /// Appends rows, all or none.
    pub(crate) fn append(&mut self, rows: &[T]) -> Result<()> {
        let lines = lines(rows)?;
        let written = self.file.write_all(&lines).inspect_err(|_| {
            // Part of a row would spoil the next one. The first error is the one to report.
            let _ = self.file.set_len(self.length);
        });
        written.with_context(|| format!("{}: cannot be written", self.path.display()))?;
        self.length += lines.len() as u64;
        Ok(())
    }
}

fn lines<T: Serialize>(rows: &[T]) -> Result<Vec<u8>> {
    let mut lines = csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new());
    rows.iter().try_for_each(|row| lines.serialize(row))?;
    Ok(lines.into_inner()?)
}

/// The rows of a file, none if there is no such file. What was cut off at its end is left out.
pub(crate) fn read<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>> {
    let bytes = match fs::read(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        bytes => bytes.with_context(|| format!("{}: cannot be read", path.display()))?,
    };
    let whole = bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
    let rows: Result<_, _> = csv::Reader::from_reader(&bytes[..whole]).into_deserialize().collect();
    rows.with_context(|| format!("{}: not rows of this program", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reproduce::accuracy::Point;
    use crate::reproduce::record::Row;

    fn row(frame: usize) -> Row {
        Row {
            // Also a letter of two bytes, which a cut may part.
            scene: "a, ö".to_owned(),
            strategy: "auto".to_owned(),
            frame,
            update_ms: 0.125,
            sah_cost: 1.0 / 3.0,
            decision: "rebuilt".to_owned(),
            ..Row::default()
        }
    }

    #[test]
    fn rows_come_back_as_they_were_and_torn_ones_do_not() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("frames.csv");
        assert_eq!(read::<Row>(&path).unwrap(), []);
        let all = [row(0), row(1), row(2)];
        Journal::create(&path, &all[..1]).unwrap().append(&all[1..]).unwrap();
        assert_eq!(read::<Row>(&path).unwrap(), all);
        let bytes = fs::read(&path).unwrap();
        assert!(bytes.starts_with(
            b"scene,strategy,threads,loop,frame,animate_ms,update_ms,trace_ms,frame_ms,sah_cost,"
        ));
        let ends: Vec<_> = (0..bytes.len()).filter(|&i| bytes[i] == b'\n').collect();
        for cut in 0..bytes.len() {
            fs::write(&path, &bytes[..cut]).unwrap();
            let whole = ends.iter().filter(|&&end| end < cut).count();
            assert_eq!(read::<Row>(&path).unwrap(), all[..whole.saturating_sub(1)], "cut at {cut}");
        }
        fs::write(&path, "scene,strategy\n1,2\n").unwrap();
        assert!(read::<Row>(&path).is_err());
    }

    #[test]
    fn points_come_back_as_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("accuracy.csv");
        let point = |error, bytes| Point {
            knob: "triangle test at 1e3".to_owned(),
            note: "with \"quotes\", commas".to_owned(),
            is_default: true,
            error,
            bytes,
            ..Point::default()
        };
        let points = [point(0.1, None), point(1e-300, Some(12))];
        let mut journal = Journal::create(&path, &[]).unwrap();
        points.iter().for_each(|point| journal.append(std::slice::from_ref(point)).unwrap());
        assert_eq!(read::<Point>(&path).unwrap(), points);
    }

    /// Half a row of the file system's is taken back, and what comes later is whole again.
    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_leaves_whole_rows() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("frames.csv");
        let mut journal = Journal::create(&path, &[row(0)]).unwrap();
        let good =
            std::mem::replace(&mut journal.file, File::options().append(true).open("/dev/full").unwrap());
        let error = format!("{:#}", journal.append(&[row(1)]).unwrap_err());
        assert!(error.contains("frames.csv") && error.contains("No space"), "{error}");
        journal.file = good;
        journal.append(&[row(2)]).unwrap();
        assert_eq!(read::<Row>(&path).unwrap(), [row(0), row(2)]);
    }
}
