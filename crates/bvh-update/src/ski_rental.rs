//! When to pay once for what costs a little in every frame.
//!
//! The rule of the ski rental problem: rent until the rent paid has reached the price, then buy. In
//! the textbook problem that costs at most twice as much as the best decision in hindsight. Here it
//! is a heuristic, since what is bought does not last. Where buying brought nothing, the next
//! purchase waits until twice as much has been lost, never longer: after a long calm full of
//! failures a burst has to be seen soon (`docs/ABLATION.md`, at
//! `a_burst_after_a_long_calm_is_seen_soon`).

use bytemuck::{Pod, Zeroable};

/// What was lost since the last purchase, and whether that brought nothing.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct SkiRental {
    lost: f64,
    /// 0 or 1.
    has_failed: u32,
    padding: u32,
}

impl SkiRental {
    /// Adds a loss; one that is no positive number adds nothing.
    pub(crate) fn charge(&mut self, loss: f64) {
        if loss > 0.0 && loss.is_finite() {
            self.lost += loss;
        }
    }

    /// What was lost.
    pub(crate) fn lost(self) -> f64 {
        self.lost
    }

    /// How many times the price is to be lost before the next purchase.
    pub(crate) fn patience(self) -> f64 {
        if self.has_failed != 0 { 2.0 } else { 1.0 }
    }

    /// Whether it is time to pay this price.
    pub(crate) fn is_due(self, price: f64) -> bool {
        self.lost > price * self.patience()
    }

    /// The price was paid for nothing; the default is that it paid off.
    pub(crate) const FAILED: Self = Self { lost: 0.0, has_failed: 1, padding: 0 };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_price_is_due_once_as_much_is_lost() {
        let mut account = SkiRental::default();
        (0..3).for_each(|_| account.charge(1.0));
        assert!(!account.is_due(3.0) && account.is_due(2.9));
    }

    #[test]
    fn after_failures_the_wait_is_twice_as_long() {
        let mut account = SkiRental::default();
        for patience in [1.0, 2.0, 2.0, 2.0] {
            assert_eq!(account.patience(), patience);
            account.charge(patience * 1.5);
            assert!(account.is_due(1.0) && !account.is_due(2.0));
            account = SkiRental::FAILED;
        }
    }

    #[test]
    fn losses_that_are_no_numbers_count_for_nothing() {
        let mut account = SkiRental::default();
        [f64::NAN, f64::INFINITY, -1.0, 0.0].into_iter().for_each(|loss| account.charge(loss));
        assert_eq!(account.lost(), 0.0);
    }
}
