//! One setting of a knob with its error and its time.

use serde::{Deserialize, Serialize};

/// One error of one setting. The names and the order of the columns are relied on by scripts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Point {
    /// Empty for knobs with input of their own.
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
    /// The factor within which errors are equal, where they are times: by so much the reference
    /// differs from itself.
    pub(crate) noise: Option<f64>,
}

impl Point {
    /// A setting of a knob and its time, without an error yet.
    pub(super) fn new(knob: &str, setting: &str, is_default: bool, time_ms: f64) -> Self {
        let (knob, setting) = (knob.to_owned(), setting.to_owned());
        Self { knob, setting, is_default, time_ms, ..Self::default() }
    }

    /// The same setting with this error.
    pub(super) fn with(&self, error_name: &str, error: f64, unit: &str) -> Self {
        Self { error_name: error_name.to_owned(), error, unit: unit.to_owned(), ..self.clone() }
    }
}
