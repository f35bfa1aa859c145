//! Charts as SVG: line panels and grouped bars. Colours come from the style sheet by class, so that a chart follows
//! the page it stands on, light or dark.

mod axis;
mod scatter;

use std::fmt::Write;

use maud::{Markup, html};

use self::axis::{Axis, tick};
pub(crate) use self::axis::{count, number};
pub(crate) use self::scatter::{Mark, SCATTER_SIZE, Scatter, Series, precise};

/// A line of a panel.
pub(crate) struct Line {
    pub(crate) class: String,
    pub(crate) name: String,
    /// In order of x.
    pub(crate) points: Vec<(f64, f64)>,
    /// Whether it is there only to be switched on.
    pub(crate) off: bool,
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
    /// Whether it is there only to be switched on.
    pub(crate) off: bool,
}

pub(crate) const PANEL_SIZE: (f64, f64) = (520.0, 300.0);
/// Left, top, right, bottom.
const MARGIN: (f64, f64, f64, f64) = (58.0, 30.0, 14.0, 40.0);
const BAR: f64 = 13.0;
const BETWEEN_GROUPS: f64 = 30.0;
/// Width of a letter of a group's label, or thereabouts.
const LETTER: f64 = 7.0;

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
            svg class="chart panel" xmlns="http://www.w3.org/2000/svg" x=(c(at.0)) y=(c(at.1)) width=(width)
                height=(height) viewBox=(format!("0 0 {width} {height}")) role="img" aria-label=(self.title)
                data-area=(format!("{left},{top},{right},{bottom}")) {
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
                    path class={ "line " (line.class) } d=(outline(&line.points, &x, &y)) data-strategy=(line.name)
                        data-off[line.off] data-x=(values(line, |p| p.0)) data-y=(values(line, |p| p.1)) {
                        title { (line.name) }
                    }
                }
            }
        }
    }
}

/// A coordinate of all points that are drawn, in the order they are drawn.
fn values(line: &Line, of: fn(&(f64, f64)) -> f64) -> String {
    let shown = |p| {
        let digits = of(p);
        if digits.fract() == 0.0 { digits.to_string() } else { number(digits) }
    };
    line.points.iter().filter(|p| p.1.is_finite()).map(shown).collect::<Vec<_>>().join(";")
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
    /// The same with nothing left to be switched on.
    pub(crate) fn all_on(mut self) -> Self {
        self.groups.iter_mut().flat_map(|(_, bars)| bars).for_each(|bar| bar.off = false);
        self
    }

    /// Places of the groups, and where the last one ends. The report's script does the same when bars are switched.
    fn places(&self) -> (Vec<f64>, f64) {
        let mut x = MARGIN.0 + 0.5 * BETWEEN_GROUPS;
        let starts = self.groups.iter().map(|(label, bars)| {
            let start = x;
            let bars = bars.iter().filter(|bar| !bar.off).count() as f64 * BAR;
            x += bars.max(LETTER * label.chars().count() as f64) + BETWEEN_GROUPS;
            start
        });
        (starts.collect(), x)
    }

    /// Width and height.
    pub(crate) fn size(&self) -> (f64, f64) {
        ((self.places().1 + MARGIN.2).max(PANEL_SIZE.0), 340.0)
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
        html! {
            svg class="chart bars" xmlns="http://www.w3.org/2000/svg" x=(c(at.0)) y=(c(at.1)) width=(width)
                height=(height) viewBox=(format!("0 0 {width} {height}")) role="img" aria-label=(self.y_label)
                data-layout=(format!("{left},{BAR},{BETWEEN_GROUPS},{LETTER},{}", MARGIN.2)) {
                (y_axis(&y, left, right, self.y_label))
                @for ((label, bars), start) in self.groups.iter().zip(self.places().0) {
                    @let x_of = |i: usize| start + BAR * bars[..i].iter().filter(|bar| !bar.off).count() as f64;
                    g data-group=(label) {
                        @for (i, bar) in bars.iter().enumerate() {
                            @let top = y.place(bar.value);
                            g class={ "bar " (bar.class) } data-strategy=(bar.name) data-off[bar.off]
                                transform=(format!("translate({:.1} 0)", x_of(i))) {
                                title {
                                    (label) ", " (bar.name) ": " (number(bar.value)) " ms, "
                                    (number(bar.low)) " to " (number(bar.high))
                                }
                                rect x="0" y=(c(top)) width=(BAR - 2.0) height=(c((bottom - top).max(0.5))) {}
                                line x1=(c(0.5 * BAR - 1.0)) x2=(c(0.5 * BAR - 1.0)) y1=(c(y.place(bar.low)))
                                    y2=(c(y.place(bar.high))) {}
                            }
                        }
                        text class="group" x=(c(start)) y=(bottom + 18.0) { (label) }
                    }
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
    fn text_is_escaped_and_coordinates_are_numbers() {
        let panel = Panel {
            title: "a < b & c".to_owned(),
            x_label: "frame",
            y_label: "ms",
            lines: vec![Line {
                class: "refit".to_owned(),
                name: "refit".to_owned(),
                points: vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.25)],
                off: false,
            }],
            rules: vec![1.0],
        };
        let svg = panel.svg((0.0, 0.0)).into_string();
        assert!(svg.contains("a &lt; b &amp; c") && !svg.contains("NaN"));
        assert!(svg.contains(r#"data-x="0;2""#) && svg.contains(r#"data-y="1;3.25""#), "{svg}");
    }
}
