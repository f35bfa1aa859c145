//! The folder of results.

use std::path::PathBuf;

use anyhow::{Context, Result};

use super::figures::Figure;
use super::results::Results;
use super::{claims, figures, report, summary};
use crate::{CheckFailed, files};

/// The folder of results.
pub(super) struct Output {
    folder: PathBuf,
}

impl Output {
    /// Makes the folder, and removes what would be mistaken for this run's results if it were interrupted.
    pub(super) fn prepare(folder: PathBuf) -> Result<Self> {
        let out = Self { folder };
        for folder in [out.folder.clone(), out.file("figures"), out.file("images")] {
            files::make_folder(&folder)?;
        }
        for name in ["report.html", "summary.json", "fig5.csv", "accuracy.csv"] {
            files::remove_old(&out.file(name))?;
        }
        files::remove_all(&out.file("figures"), is_figure)?;
        files::remove_all(&out.file("images"), is_picture)?;
        Ok(out)
    }

    pub(super) fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Name and path of the picture of a frame.
    pub(super) fn picture(&self, slug: &str, frame: usize) -> (String, PathBuf) {
        let name = format!("{slug}-{frame:04}.png");
        let path = self.file("images").join(&name);
        (name, path)
    }

    /// Writes figures, summary and report, and says what came out.
    pub(super) fn write(&self, results: &Results) -> Result<()> {
        let claims = claims::judge(results);
        let figures = figures::files(results);
        for Figure { name, svg } in &figures {
            files::write_whole(&self.file("figures").join(format!("{name}.svg")), svg.as_bytes())?;
        }
        let summary = summary::json(results, &claims).context("the summary cannot be written as JSON")?;
        files::write_whole(&self.file("summary.json"), summary.as_bytes())?;
        let report = self.file("report.html");
        files::write_whole(&report, report::html(results, &claims).as_bytes())?;

        let checks = results.checks();
        let text = format!(
            "{}\n{}\n{}",
            summary::claims_in_lines(&claims),
            summary::checks_in_words(&checks),
            files::shown(&report)
        );
        files::print(&text)?;
        match checks.first_difference {
            Some(first) => {
                let count = checks.differences;
                Err(CheckFailed(format!("strategies disagree, {count} times, first {first}")).into())
            }
            None => Ok(()),
        }
    }
}

/// Whether a file's name is one that this program gives to figures.
fn is_figure(name: &str) -> bool {
    name.ends_with(".svg") && ["fig", "accuracy-"].iter().any(|start| name.starts_with(start))
}

/// Whether a file's name is one that [`Output::picture`] gives.
fn is_picture(name: &str) -> bool {
    let number = name.strip_suffix(".png").and_then(|stem| stem.rsplit_once('-'));
    number.is_some_and(|(_, n)| n.len() >= 4 && n.bytes().all(|b| b.is_ascii_digit()))
}
