//! What contestants are tested with: a scene that drifts apart, and every triangle for every ray.

mod brute;
mod soup;

pub(crate) use brute::Brute;
pub(crate) use soup::Soup;
