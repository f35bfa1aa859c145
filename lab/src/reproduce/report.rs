//! `report.html`: one page with everything in it, readable offline, on a phone and on paper. The
//! page holds what was measured as data, and `report.js` draws it.

mod answer;

use std::collections::BTreeMap;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use self::answer::{advice, headline, speedup};
use super::accuracy::sentences;
use super::claims::Claim;
use super::figures::Figure;
use super::results::{Results, SceneRun};
use super::summary::{Summary, checks_in_words};
use crate::compare::Row as Peer;

/// What the script draws.
#[derive(Serialize)]
struct Page<'a> {
    #[serde(flatten)]
    summary: Summary<'a>,
    headline: String,
    /// The strategy to use, and how it does.
    advice: Option<(&'a str, String)>,
    notice: Option<&'static str>,
    /// What was checked, in words.
    checked: String,
    /// What accuracy costs.
    sentences: Vec<String>,
    figures: &'a [Figure],
    /// Addresses that hold the pictures themselves, by file.
    pictures: BTreeMap<&'a str, String>,
    /// More of scenes, by label.
    more: BTreeMap<&'a str, More<'a>>,
}

/// What the summary does not have of a scene.
#[derive(Serialize)]
struct More<'a> {
    /// How many times as fast frames are with rotations as with refitting alone.
    speedup: Option<f64>,
    /// The pictured frame on which refitting fares worst.
    worst: Option<usize>,
    peers: &'a [Peer],
}

const INTERRUPTED: &str = "The run was interrupted. What follows is made from the rows measured until then.";

/// The whole page.
pub(crate) fn html(results: &Results, claims: &[Claim], figures: &[Figure]) -> serde_json::Result<String> {
    let pictures = results.scenes.iter().flat_map(|scene| &scene.pictures).map(|picture| {
        let kind = if picture.file.ends_with(".jpg") { "jpeg" } else { "png" };
        let address = format!("data:image/{kind};base64,{}", STANDARD.encode(&picture.bytes));
        (picture.file.as_str(), address)
    });
    let more = results.scenes.iter().map(|scene| {
        let (speedup, worst) = (speedup(scene), worst(scene));
        (scene.label.as_str(), More { speedup, worst, peers: &scene.peers })
    });
    let page = Page {
        summary: Summary::new(results, claims),
        headline: headline(results),
        advice: advice(results),
        notice: results.interrupted.then_some(INTERRUPTED),
        checked: checks_in_words(&results.checks()),
        sentences: sentences(&results.accuracy),
        figures,
        pictures: pictures.collect(),
        more: more.collect(),
    };
    // No text in it ends the script.
    let data = serde_json::to_string(&page)?.replace("</", "<\\/").replace("<!", "<\\u0021");
    let [style, script] = [include_str!("report.css"), include_str!("report.js")].map(str::trim_end);
    let page = include_str!("report.html").trim_end().replace("STYLE", style).replace("SCRIPT", script);
    Ok(page.replace("DATA", &data))
}

/// Of the frames with heat maps of both trees that on which refitting costs most, over a fresh
/// tree.
fn worst(scene: &SceneRun) -> Option<usize> {
    let has = |frame: usize, strategy: &str| {
        scene.pictures.iter().any(|p| p.frame == frame && p.strategy.as_deref() == Some(strategy))
    };
    let pairs = scene.pairs("refit", "ideal");
    let excess = |frame: usize| {
        let pair = pairs.iter().find(|(row, _)| row.round == 0 && row.frame == frame);
        pair.map_or(0.0, |(refit, fresh)| refit.sah_cost / fresh.sah_cost)
    };
    let frames = scene.pictures.iter().map(|picture| picture.frame);
    let both = frames.filter(|&frame| has(frame, "refit") && has(frame, "refit+rotate"));
    both.max_by(|&a, &b| excess(a).total_cmp(&excess(b)))
}
