//! Charts as SVG: line panels and grouped bars. Colours come from the style sheet by class, so that a chart follows
//! the page it stands on, light or dark.

use std::fmt::Write;

use maud::{Markup, html};

/// A line of a panel.
pub(crate) struct Line {
    pub(crate) class: String,
    pub(crate) name: String,
    /// In order of x.
    pub(crate) points: Vec<(f64, f64)>,
}

/// Lines over common axes.
pub(crate) struct Panel<'a> {
    pub(crate) title: String,
    pub(crate) x_label: &'a str,
    pub(crate) y_label: &'a str,
    pub(crate) lines: Vec<Line>,
    /// Where to rule vertical lines, with nothing to say about them but that something starts anew.
    pub(crate) rules: Vec<f64>,
}

/// Bars in groups; heights on a logarithmic scale.
pub(crate) struct Bars<'a> {
    pub(crate) y_label: &'a str,
    pub(crate) groups: Vec<(String, Vec<Bar>)>,
}

/// A bar with the range it stands for.
pub(crate) struct Bar {
    pub(crate) class: String,
    pub(crate) name: String,
    pub(crate) value: f64,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

pub(crate) const PANEL_SIZE: (f64, f64) = (520.0, 300.0);
/// Left, top, right, bottom.
const MARGIN: (f64, f64, f64, f64) = (58.0, 30.0, 14.0, 40.0);
const BAR: f64 = 13.0;
const BETWEEN_GROUPS: f64 = 30.0;

/// Values of an axis and their places.
struct Axis {
    low: f64,
    high: f64,
    log: bool,
    /// Places of the two ends.
    from: f64,
    to: f64,
}

impl Axis {
    /// Linear from zero; logarithmic if the values span more than a factor of 20.
    fn fitting(values: impl Iterator<Item = f64> + Clone, from: f64, to: f64) -> Self {
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
    fn log(low: f64, high: f64, from: f64, to: f64) -> Self {
        let decade = 10f64.powf(low.log10().floor());
        let low = [5.0, 2.0, 1.0].map(|m| m * decade).into_iter().find(|&l| l < low).unwrap_or(decade);
        Self { low, high: high * 1.3, log: true, from, to }
    }

    fn place(&self, value: f64) -> f64 {
        let part = if self.log {
            (value.max(self.low) / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        };
        self.from + (self.to - self.from) * part
    }

    fn ticks(&self) -> Vec<f64> {
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
        if i > 0 && (digits.len() - i) % 3 == 0 && !out.ends_with('-') {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

/// A tick's number, without needless zeros.
fn tick(value: f64) -> String {
    let text = number(value);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

fn y_axis(axis: &Axis, left: f64, right: f64, label: &str) -> Markup {
    html! {
        @for t in axis.ticks() {
            @let y = axis.place(t);
            line class="grid" x1=(left) x2=(right) y1=(c(y)) y2=(c(y)) {}
            text class="tick" x=(left - 6.0) y=(c(y + 4.0)) text-anchor="end" { (tick(t)) }
        }
        text class="label" x="4" y="14" { (label) @if axis.log { " (logarithmic)" } }
    }
}

/// A coordinate to a tenth.
fn c(value: f64) -> String {
    format!("{value:.1}")
}

impl Panel<'_> {
    /// The panel as an `svg` element of [`PANEL_SIZE`], to stand alone or within another at `(x, y)`.
    pub(crate) fn svg(&self, at: (f64, f64)) -> Markup {
        let (width, height) = PANEL_SIZE;
        let (left, top, right, bottom) = (MARGIN.0, MARGIN.1, width - MARGIN.2, height - MARGIN.3);
        let points = || self.lines.iter().flat_map(|line| &line.points);
        let last = points().map(|p| p.0).fold(0.0, f64::max).max(1e-9);
        let x = Axis { low: 0.0, high: last, log: false, from: left, to: right };
        let y = Axis::fitting(points().map(|p| p.1), bottom, top);
        html! {
            svg class="chart" xmlns="http://www.w3.org/2000/svg" x=(c(at.0)) y=(c(at.1)) width=(width)
                height=(height) viewBox=(format!("0 0 {width} {height}")) role="img" aria-label=(self.title) {
                (y_axis(&y, left, right, self.y_label))
                text class="title" x=(right) y="14" text-anchor="end" { (self.title) }
                @for &rule in &self.rules {
                    line class="rule" x1=(c(x.place(rule))) x2=(c(x.place(rule))) y1=(top) y2=(bottom) {}
                }
                @for t in x.ticks() {
                    text class="tick" x=(c(x.place(t))) y=(bottom + 16.0) text-anchor="middle" { (tick(t)) }
                }
                line class="axis" x1=(left) x2=(right) y1=(bottom) y2=(bottom) {}
                text class="label" x=(c(0.5 * (left + right))) y=(height - 6.0) text-anchor="middle" {
                    (self.x_label)
                }
                @for line in &self.lines {
                    path class={ "line " (line.class) } d=(outline(&line.points, &x, &y)) { title { (line.name) } }
                }
            }
        }
    }
}

fn outline(points: &[(f64, f64)], x: &Axis, y: &Axis) -> String {
    let mut d = String::new();
    for (i, &(px, py)) in points.iter().filter(|p| p.1.is_finite()).enumerate() {
        let to = if i == 0 { 'M' } else { 'L' };
        // Writing to a string does not fail.
        let _ = write!(d, "{to}{:.1} {:.1}", x.place(px), y.place(py));
    }
    if points.len() == 1 {
        d.push_str("h4");
    }
    d
}

impl Bars<'_> {
    /// Width and height.
    pub(crate) fn size(&self) -> (f64, f64) {
        let groups = self.groups.iter().map(|(_, bars)| bars.len() as f64 * BAR + BETWEEN_GROUPS);
        ((MARGIN.0 + groups.sum::<f64>() + MARGIN.2).max(PANEL_SIZE.0), 340.0)
    }

    /// The bars as an `svg` element of that size at `(x, y)`.
    pub(crate) fn svg(&self, at: (f64, f64)) -> Markup {
        let (width, height) = self.size();
        let (left, top, right, bottom) = (MARGIN.0, MARGIN.1, width - MARGIN.2, height - MARGIN.3);
        let bars = || self.groups.iter().flat_map(|(_, bars)| bars);
        let lowest = bars().map(|b| b.low).filter(|&v| v > 0.0).fold(f64::INFINITY, f64::min);
        let highest = bars().map(|b| b.high).fold(0.0, f64::max);
        let y = if lowest.is_finite() {
            Axis::log(lowest * 0.7, highest, bottom, top)
        } else {
            Axis::log(0.1, 1.0, bottom, top)
        };
        let mut from = left + 0.5 * BETWEEN_GROUPS;
        let starts: Vec<f64> = self
            .groups
            .iter()
            .map(|(_, bars)| {
                let start = from;
                from += bars.len() as f64 * BAR + BETWEEN_GROUPS;
                start
            })
            .collect();
        html! {
            svg class="chart" xmlns="http://www.w3.org/2000/svg" x=(c(at.0)) y=(c(at.1)) width=(width)
                height=(height) viewBox=(format!("0 0 {width} {height}")) role="img" aria-label=(self.y_label) {
                (y_axis(&y, left, right, self.y_label))
                @for ((label, bars), start) in self.groups.iter().zip(starts) {
                    @let middle = start + 0.5 * bars.len() as f64 * BAR;
                    @for (i, bar) in bars.iter().enumerate() {
                        @let x = start + i as f64 * BAR;
                        @let top = y.place(bar.value);
                        g class={ "bar " (bar.class) } {
                            title {
                                (label) ", " (bar.name) ": " (number(bar.value)) " ms, "
                                (number(bar.low)) " to " (number(bar.high))
                            }
                            rect x=(c(x)) y=(c(top)) width=(BAR - 2.0) height=(c((bottom - top).max(0.5))) {}
                            line x1=(c(x + 0.5 * BAR - 1.0)) x2=(c(x + 0.5 * BAR - 1.0)) y1=(c(y.place(bar.low)))
                                y2=(c(y.place(bar.high))) {}
                        }
                    }
                    text class="group" x=(c(middle)) y=(bottom + 18.0) text-anchor="middle" { (label) }
                }
                line class="axis" x1=(left) x2=(right) y1=(bottom) y2=(bottom) {}
            }
        }
    }
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

    #[test]
    fn text_is_escaped_and_coordinates_are_numbers() {
        let panel = Panel {
            title: "a < b & c".to_owned(),
            x_label: "frame",
            y_label: "ms",
            lines: vec![Line {
                class: "refit".to_owned(),
                name: "refit".to_owned(),
                points: vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0)],
            }],
            rules: vec![1.0],
        };
        let svg = panel.svg((0.0, 0.0)).into_string();
        assert!(svg.contains("a &lt; b &amp; c") && !svg.contains("NaN"));
    }
}
