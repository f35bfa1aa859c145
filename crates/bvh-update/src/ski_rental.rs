//! When to pay once for what costs a little in every frame.
//!
//! The rule of the ski rental problem: rent until the rent paid has reached the price, then buy.
//! Whatever the future, that costs at most twice as much as the best decision in hindsight. Where
//! buying brought nothing, the next purchase waits until twice as much has been lost.

use bytemuck::{Pod, Zeroable};

/// What was lost since the last purchase, and how many purchases in a row brought nothing.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct SkiRental {
    lost: f64,
    failures: u32,
    padding: u32,
}

/// Failures beyond this many make no wait longer: after a long calm full of failures a burst has to
/// be seen soon. `docs/ABLATION.md` has other values.
const MOST_FAILURES: u32 = 1;

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
        f64::from(1u32 << self.failures.min(MOST_FAILURES))
    }

    /// Whether it is time to pay this price.
    pub(crate) fn is_due(self, price: f64) -> bool {
        self.lost > price * self.patience()
    }

    /// The price was paid, and it paid off.
    pub(crate) fn paid_off(&mut self) {
        *self = Self::default();
    }

    /// The price was paid for nothing.
    pub(crate) fn failed(&mut self) {
        (self.lost, self.failures) = (0.0, self.failures.saturating_add(1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_price_is_due_once_as_much_is_lost() {
        let mut account = SkiRental::default();
        (0..3).for_each(|_| account.charge(1.0));
        assert!(!account.is_due(3.0) && account.is_due(2.9));
        account.paid_off();
        assert_eq!(account, SkiRental::default());
    }

    #[test]
    fn each_failure_doubles_the_wait() {
        let mut account = SkiRental::default();
        for failures in 0..20u32 {
            assert_eq!(account.patience(), f64::from(1 << failures.min(MOST_FAILURES)));
            account.charge(account.patience() * 1.5);
            assert!(account.is_due(1.0) && !account.is_due(2.0));
            account.failed();
            assert_eq!(account.lost(), 0.0);
        }
    }

    #[test]
    fn losses_that_are_no_numbers_count_for_nothing() {
        let mut account = SkiRental::default();
        [f64::NAN, f64::INFINITY, -1.0, 0.0].into_iter().for_each(|loss| account.charge(loss));
        assert_eq!(account.lost(), 0.0);
    }
}
