//! Axes, their ticks, and numbers as they are written on them.

/// Values of an axis and their places.
pub(super) struct Axis {
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) log: bool,
    /// Places of the two ends.
    pub(super) from: f64,
    pub(super) to: f64,
}

impl Axis {
    /// Linear from zero; logarithmic if the values span more than a factor of 20.
    pub(super) fn fitting(values: impl Iterator<Item = f64> + Clone, from: f64, to: f64) -> Self {
        let usable = values.filter(|v| v.is_finite());
        let high = usable.clone().fold(0.0, f64::max);
        let low = usable.filter(|&v| v > 0.0).fold(f64::INFINITY, f64::min);
        if high > 0.0 && high > 20.0 * low {
            return Self::log(low, high, from, to);
        }
        let high = if high > 0.0 { high } else { 1.0 };
        Self { low: 0.0, high: high * 1.08, log: false, from, to }
    }

    /// Logarithmic, from a power of ten or half of one to a bit above the highest.
    pub(super) fn log(low: f64, high: f64, from: f64, to: f64) -> Self {
        let decade = 10f64.powf(low.log10().floor());
        let low = [5.0, 2.0, 1.0].map(|m| m * decade).into_iter().find(|&l| l < low).unwrap_or(decade);
        Self { low, high: high * 1.3, log: true, from, to }
    }

    pub(super) fn place(&self, value: f64) -> f64 {
        let part = if self.log {
            (value.max(self.low) / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        };
        self.from + (self.to - self.from) * part
    }

    pub(super) fn ticks(&self) -> Vec<f64> {
        if self.log {
            let decades = (self.high / self.low).log10();
            let steps: &[f64] = if decades > 3.5 {
                &[1.0]
            } else if decades > 1.6 {
                &[1.0, 3.0]
            } else {
                &[1.0, 2.0, 5.0]
            };
            let first = self.low.log10().floor() as i32;
            let all = (first..first + 40).flat_map(|e| steps.iter().map(move |s| s * 10f64.powi(e)));
            return all.skip_while(|&t| t < self.low * 0.999).take_while(|&t| t <= self.high).collect();
        }
        let rough = (self.high - self.low) / 5.0;
        let decade = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * decade).into_iter().find(|&s| s >= rough);
        let step = step.unwrap_or(10.0 * decade);
        let first = (self.low / step).ceil();
        let count = ((self.high - self.low) / step).floor() as usize + 1;
        (0..count).map(|i| (first + i as f64) * step).filter(|&t| t <= self.high).collect()
    }
}

/// A number as short as it may be: three digits, thousands set apart.
pub(crate) fn number(value: f64) -> String {
    let magnitude = value.abs();
    if !value.is_finite() {
        return "–".to_owned();
    }
    let decimals = match magnitude {
        m if m >= 999.5 => return thousands(&format!("{value:.0}")),
        m if m >= 99.95 || m == 0.0 => 0,
        m if m >= 9.995 => 1,
        m if m >= 0.9995 => 2,
        _ => 3,
    };
    format!("{value:.decimals$}")
}

/// How many of something.
pub(crate) fn count(n: u64) -> String {
    thousands(&n.to_string())
}

/// Digits, perhaps signed, in groups of three.
fn thousands(digits: &str) -> String {
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) && !out.ends_with('-') {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

/// A tick's number, without needless zeros.
pub(super) fn tick(value: f64) -> String {
    let text = number(value);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_choose_their_scale_and_round_ticks() {
        let linear = Axis::fitting([3.0, 11.0].into_iter(), 100.0, 0.0);
        assert!(!linear.log);
        assert_eq!(linear.ticks(), [0.0, 5.0, 10.0]);
        assert_eq!(linear.place(0.0), 100.0);
        let log = Axis::fitting([30.0, 9000.0].into_iter(), 100.0, 0.0);
        assert!(log.log);
        assert_eq!(log.ticks(), [30.0, 100.0, 300.0, 1000.0, 3000.0, 10000.0]);
        assert!(Axis::fitting([0.0, f64::NAN].into_iter(), 1.0, 0.0).ticks().len() > 1);
    }

    #[test]
    fn numbers_have_three_digits() {
        let shown = [0.0123, 0.5, 1.0, 9.999, 12.34, 99.99, 123.4, 1234.5, 1_234_567.0, -1234.0];
        let expected =
            ["0.012", "0.500", "1.00", "10.0", "12.3", "100", "123", "1 234", "1 234 567", "-1 234"];
        for (value, text) in shown.into_iter().zip(expected) {
            assert_eq!(number(value).replace('\u{202f}', " "), text);
        }
        assert_eq!(tick(0.5), "0.5");
        assert_eq!(tick(10.0), "10");
    }
}
