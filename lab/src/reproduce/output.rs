//! The folder of results.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};

use super::figures::Figure;
use super::results::{Picture, Results};
use super::summary::Summary;
use super::{accuracy, claims, figures, report, summary};
use crate::{CheckFailed, files, stage};

/// The folder of results, locked for this run.
pub(super) struct Output {
    folder: PathBuf,
    _lock: Option<File>,
}

impl Output {
    /// Makes the folder and those in it, but takes no folder of the user's own: its files may have
    /// names that a run replaces or removes. What killed runs have left half-written there goes, if
    /// it is certain that no other run is writing.
    pub(super) fn prepare(folder: PathBuf) -> Result<Self> {
        // Published results have no lock.
        let has_summary =
            || fs::read_to_string(folder.join("summary.json")).is_ok_and(|s| s.contains("\"schema\""));
        let is_ours = folder.join(files::LOCK).exists() || has_summary();
        if let (false, Some(Ok(first))) = (is_ours, fs::read_dir(&folder).into_iter().flatten().next()) {
            let (folder, first) = (folder.display(), first.file_name());
            bail!(
                "{folder}: holds {}, but no results; name a new or an empty folder with --out",
                first.display()
            );
        }
        files::make_folder(&folder)?;
        let lock = files::lock(&folder)?;
        for folder in [folder.join("figures"), folder.join("images"), folder.clone()] {
            files::make_folder(&folder)?;
            if lock.is_some() {
                let [start, end] = scenes::PARTIAL;
                files::remove_all(&folder, |name| name.starts_with(start) && name.ends_with(end))?;
            }
        }
        Ok(Self { folder, _lock: lock })
    }

    /// Takes rows and pictures over from another folder, unless it is this one.
    pub(super) fn copy_from(self, other: &Path) -> Result<Self> {
        if fs::canonicalize(other)? == fs::canonicalize(&self.folder)? {
            return Ok(self);
        }
        let images = fs::read_dir(other.join("images")).into_iter().flatten().flatten();
        let images = images.map(|entry| Path::new("images").join(entry.file_name()));
        // The summary here is of other rows.
        files::remove_old(&self.file("summary.json"))?;
        let rows = ["frames.csv", "fig5.csv", "accuracy.csv", "peers.csv"].map(PathBuf::from);
        for name in rows.into_iter().chain(images) {
            let (from, to) = (other.join(&name), self.folder.join(&name));
            if from.is_file() {
                files::write_whole(&to, &files::read(&from)?)?;
            } else {
                files::remove_old(&to)?;
            }
        }
        Ok(self)
    }

    pub(super) fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Writes the picture of a frame, or the heat map of a strategy's tree.
    pub(super) fn picture(
        &self,
        label: &str,
        frame: usize,
        strategy: Option<&str>,
        bytes: Vec<u8>,
    ) -> Result<Picture> {
        let end = strategy.map_or(".png".to_owned(), |strategy| format!("-{strategy}.jpg"));
        let file = format!("{}-{frame:04}{end}", stage::slug(label));
        files::write_whole(&self.file("images").join(&file), &bytes)?;
        Ok(Picture { frame, strategy: strategy.map(str::to_owned), file, bytes })
    }

    /// Writes what is known so far, so that a run that is killed can be gone on with.
    pub(super) fn write_summary(&self, results: &Results, claims: &[claims::Claim]) -> Result<()> {
        let summary = serde_json::to_string_pretty(&Summary::new(results, claims))? + "\n";
        files::write_whole(&self.file("summary.json"), summary.as_bytes())
    }

    /// Writes figures, summary and report, and says what came out.
    pub(super) fn write(&self, results: &Results) -> Result<()> {
        let claims = claims::judge(results);
        // Figures, and pictures that are not of these results.
        files::remove_all(&self.file("figures"), |name| {
            name.ends_with(".svg")
                && ["fig", "accuracy-", "museum-"].iter().any(|start| name.starts_with(start))
        })?;
        let pictures = || results.scenes.iter().flat_map(|scene| &scene.pictures);
        files::remove_all(&self.file("images"), |name| {
            is_picture(name) && pictures().all(|picture| picture.file != name)
        })?;
        let figures = figures::all(results);
        for Figure { name, svg, .. } in &figures {
            files::write_whole(&self.file("figures").join(format!("{name}.svg")), svg.as_bytes())?;
        }
        self.write_summary(results, &claims)?;
        files::write_whole(&self.file("tables.md"), summary::tables(results, &claims).as_bytes())?;
        let report = self.file("report.html");
        files::write_whole(&report, report::html(results, &claims, &figures)?.as_bytes())?;

        let checks = results.checks();
        let judged =
            results.scenes.iter().any(|scene| !scene.rows.is_empty() || !scene.speed_rows.is_empty());
        let mut lines = Vec::new();
        if !results.interrupted {
            lines.extend(judged.then(|| results.answer(&claims)));
            lines.extend(accuracy::sentences(&results.accuracy));
            lines.push(summary::checks_in_words(&checks));
        }
        lines.push(files::shown(&report));
        files::print(&lines.join("\n"))?;
        if let Some(first) = &checks.first_difference {
            let count = checks.differences;
            bail!(CheckFailed(format!("strategies disagree, {count} times, first {first}")));
        }
        Ok(())
    }
}

/// Whether a file's name is one that [`Output::picture`] gives.
fn is_picture(name: &str) -> bool {
    let is_frame = |part: &str| part.len() >= 4 && part.bytes().all(|b| b.is_ascii_digit());
    match name.rsplit_once('.') {
        Some((stem, "png")) => stem.rsplit('-').next().is_some_and(is_frame),
        Some((stem, "jpg")) => stem.split('-').any(is_frame),
        _ => false,
    }
}
