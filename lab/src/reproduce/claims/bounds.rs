//! The bounds of all verdicts, from one file that is never changed: `bounds.json`.

use serde::Deserialize;

/// The file, in this folder.
const FILE: &str = include_str!("bounds.json");

/// Where each claim holds; the file has the paper's words for each.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Bounds {
    pub(super) equal: f64,
    pub(super) overhead: f64,
    pub(super) overhead_in_part: f64,
    pub(super) magnitude: f64,
    pub(super) refit_scenes: f64,
    pub(super) ideal_close: f64,
    pub(super) very_close: f64,
    #[serde(rename = "match")]
    pub(super) matches: f64,
    pub(super) slower: f64,
    pub(super) first_rules: bool,
    pub(super) explodes: f64,
    pub(super) key_frames: f64,
    pub(super) key_frames_in_part: f64,
    pub(super) stable: f64,
    pub(super) annealed: f64,
    pub(super) quarter_low: f64,
    pub(super) quarter_high: f64,
    pub(super) worst_frame: f64,
    pub(super) insensitive: f64,
    pub(super) as_poor: f64,
    pub(super) hlbvh: f64,
    pub(super) fewer_cores: f64,
    pub(super) settles: f64,
    pub(super) fast_motion: f64,
    pub(super) memory: f64,
}

/// Both sets: as they were first, and as they are.
#[derive(Clone, Debug, Deserialize)]
pub(super) struct Both {
    pub(super) first: Bounds,
    pub(super) present: Bounds,
}

impl Both {
    pub(super) fn read() -> Self {
        serde_json::from_str(FILE).expect("a file that a test reads")
    }
}

impl Bounds {
    /// Beyond noise.
    pub(super) fn faster(&self, ratio: f64) -> bool {
        ratio <= 1.0 / self.equal
    }

    /// Beyond noise.
    pub(super) fn slower_than(&self, ratio: f64) -> bool {
        ratio >= self.equal
    }

    /// What a ratio of times says of its numerator.
    pub(super) fn in_words(&self, ratio: f64) -> &'static str {
        if self.faster(ratio) {
            "faster"
        } else if self.slower_than(ratio) {
            "slower"
        } else {
            "as fast"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whoever changes a bound changes this number, too, and says why in docs/PAPER.md.
    #[test]
    fn bounds_are_frozen() {
        let digest = FILE
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
        assert_eq!(digest, 18_186_478_218_745_304_428, "{digest}");
        let Both { first, present } = Both::read();
        let file: serde_json::Value = serde_json::from_str(FILE).expect("JSON");
        let words = file["words"].as_object().expect("the paper's words");
        let fields = |bounds: &Bounds| format!("{bounds:?}").matches(": ").count();
        assert_eq!([fields(&first), fields(&present)], [words.len(); 2]);
        assert!(words.values().all(serde_json::Value::is_string) && first != present);
    }
}
