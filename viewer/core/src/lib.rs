//! The viewer without a window: events in, pictures out.
//!
//! A [`State`] takes [`Event`]s and draws itself onto a [`Canvas`]. It has no window, no threads of
//! its own and no clock: a shell gives it events, calls it within a rayon pool, shows its pictures,
//! and does what it [requests](State::take_requests). It may also take [steps](State::take_step) to
//! another thread. So tests drive it without a window, and the same code runs in a browser.
#![forbid(unsafe_code)]

mod boxes;
mod canvas;
mod controls;
mod draw;
mod events;
mod eye;
mod overlay;
mod ready;
mod side;
mod srgb;
mod state;
mod step;

pub use canvas::Canvas;
pub use controls::Settings;
pub use events::{Button, Event, Key, Request};
pub use ready::{FreshCosts, Ready};
pub use state::State;
pub use step::Step;

/// Gives the time in seconds since any moment. What takes time is measured by it; nothing else
/// depends on it.
pub type Clock = fn() -> f64;
