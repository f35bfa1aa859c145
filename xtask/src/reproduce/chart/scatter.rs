//! Settings scattered over cost and error, with their names beside them and the Pareto front through them.

use maud::{Markup, html};

use super::axis::{Axis, number};
use super::c;

/// Settings under one condition.
pub(crate) struct Series<'a> {
    /// What sets it apart from the other series; empty if there is but one.
    pub(crate) name: &'a str,
    pub(crate) marks: Vec<Mark<'a>>,
}

/// A setting.
pub(crate) struct Mark<'a> {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) label: &'a str,
    pub(crate) on_front: bool,
    pub(crate) is_default: bool,
    /// What is shown when it is pointed at.
    pub(crate) hover: String,
}

impl Series<'_> {
    /// The marks that have a place.
    fn drawn(&self) -> impl Iterator<Item = &Mark<'_>> {
        let has_place = |x: f64, y: f64| x > 0.0 && x.is_finite() && y >= 0.0 && y.is_finite();
        self.marks.iter().filter(move |mark| has_place(mark.x, mark.y))
    }
}

/// Series over common axes.
pub(crate) struct Scatter<'a> {
    pub(crate) title: &'a str,
    pub(crate) x_label: String,
    pub(crate) y_label: String,
    pub(crate) series: Vec<Series<'a>>,
}

/// Width and height.
pub(crate) const SCATTER_SIZE: (f64, f64) = (520.0, 330.0);
/// Left, top, right, bottom.
const MARGIN: (f64, f64, f64, f64) = (64.0, 62.0, 20.0, 44.0);
/// Height of the band at the bottom for what is zero.
const ZERO_BAND: f64 = 22.0;
/// Colours of the style sheet, in the order of series.
const COLORS: [&str; 6] = ["rotate", "refit", "parallel", "binned", "measured", "sweep"];

/// A number as short as it may be, powers of ten split off where it is small.
pub(crate) fn precise(value: f64) -> String {
    let magnitude = value.abs();
    if magnitude == 0.0 || magnitude >= 0.01 || !value.is_finite() {
        number(value)
    } else {
        format!("{value:.1e}")
    }
}

/// A tick's number.
fn tick(value: f64) -> String {
    if value.abs() >= 1e-3 || value == 0.0 {
        super::axis::tick(value)
    } else {
        format!("{value:.1e}").replace(".0e", "e")
    }
}

impl Scatter<'_> {
    fn marks(&self) -> impl Iterator<Item = &Mark<'_>> {
        self.series.iter().flat_map(Series::drawn)
    }

    /// The panel as an `svg` element of [`SCATTER_SIZE`], to stand alone or within another at `(x, y)`.
    pub(crate) fn svg(&self, at: (f64, f64)) -> Markup {
        let (width, height) = SCATTER_SIZE;
        let (left, top, right, bottom) = (MARGIN.0, MARGIN.1, width - MARGIN.2, height - MARGIN.3);
        let zeros = self.marks().any(|mark| mark.y == 0.0);
        let floor = if zeros { bottom - ZERO_BAND } else { bottom };
        let x = spanning(self.marks().map(|mark| mark.x), left, right);
        let y = spanning(self.marks().map(|mark| mark.y), floor, top);
        let place = |mark: &Mark<'_>| {
            (x.place(mark.x), if mark.y == 0.0 { bottom - 0.4 * ZERO_BAND } else { y.place(mark.y) })
        };
        let labels = self.labels(&place, (left, top, right, bottom));
        html! {
            svg class="chart scatter" xmlns="http://www.w3.org/2000/svg" x=(c(at.0)) y=(c(at.1)) width=(width)
                height=(height) viewBox=(format!("0 0 {width} {height}")) role="img"
                aria-label={ (self.title) ": " (self.y_label) } {
                text class="title" x="4" y="14" { (self.title) }
                text class="label" x="4" y="31" { (self.y_label) (scale(&y)) }
                (self.legend())
                @if self.marks().any(|mark| mark.y > 0.0) {
                    @for t in y.ticks() {
                        line class="grid" x1=(left) x2=(right) y1=(c(y.place(t))) y2=(c(y.place(t))) {}
                        text class="tick" x=(left - 6.0) y=(c(y.place(t) + 4.0)) text-anchor="end" { (tick(t)) }
                    }
                }
                @if zeros {
                    line class="rule" x1=(left) x2=(right) y1=(c(floor)) y2=(c(floor)) {}
                    text class="tick" x=(left - 6.0) y=(c(bottom - 0.4 * ZERO_BAND + 4.0)) text-anchor="end" { "0" }
                }
                @for t in x.ticks() {
                    line class="grid" x1=(c(x.place(t))) x2=(c(x.place(t))) y1=(top) y2=(c(bottom)) {}
                    text class="tick" x=(c(x.place(t))) y=(bottom + 16.0) text-anchor="middle" { (tick(t)) }
                }
                line class="axis" x1=(left) x2=(right) y1=(bottom) y2=(bottom) {}
                text class="label" x=(c(0.5 * (left + right))) y=(height - 8.0) text-anchor="middle" {
                    (self.x_label) (scale(&x))
                }
                @for (i, series) in self.series.iter().enumerate() {
                    g style=(color(i)) {
                        path class="line" d=(path(&front(series, &place))) {}
                        @for mark in series.drawn() {
                            @let (cx, cy) = place(mark);
                            g {
                                title { (mark.hover) }
                                @if mark.is_default {
                                    circle cx=(c(cx)) cy=(c(cy)) r="7.5" fill="none" stroke="currentColor" stroke-width="1.4" {}
                                }
                                circle cx=(c(cx)) cy=(c(cy)) r="3.8" stroke="currentColor" stroke-width="1.4"
                                    fill=(if mark.on_front { "currentColor" } else { "var(--paper)" }) {}
                            }
                        }
                    }
                }
                @for label in &labels {
                    text class="label" x=(c(label.x)) y=(c(label.y)) { (label.text) }
                }
            }
        }
    }

    fn legend(&self) -> Markup {
        if self.series.len() < 2 {
            return Markup::default();
        }
        let starts = self.series.iter().scan(4.0, |x, series| {
            let start = *x;
            *x += 18.0 + text_width(series.name);
            Some(start)
        });
        html! {
            @for ((i, series), x) in self.series.iter().enumerate().zip(starts) {
                circle style=(color(i)) cx=(c(x + 4.0)) cy="44" r="3.8" fill="currentColor" {}
                text class="label" x=(c(x + 12.0)) y="48" { (series.name) }
            }
        }
    }

    /// Names beside their marks where there is room, those of the default and of the front first. A name is written once.
    fn labels(
        &self,
        place: &impl Fn(&Mark<'_>) -> (f64, f64),
        (left, top, right, bottom): (f64, f64, f64, f64),
    ) -> Vec<Label<'_>> {
        let mut marks: Vec<&Mark<'_>> = self.marks().collect();
        marks.sort_by_key(|mark| (!mark.is_default, !mark.on_front));
        let mut taken: Vec<Rect> = marks
            .iter()
            .map(|mark| {
                let ((x, y), r) = (place(mark), if mark.is_default { 8.0 } else { 4.5 });
                Rect { left: x - r, top: y - r, right: x + r, bottom: y + r }
            })
            .collect();
        for series in &self.series {
            let corners = front(series, place);
            taken.extend(corners.windows(2).map(|pair| Rect {
                left: pair[0].0.min(pair[1].0) - 1.0,
                top: pair[0].1.min(pair[1].1) - 1.0,
                right: pair[0].0.max(pair[1].0) + 1.0,
                bottom: pair[0].1.max(pair[1].1) + 1.0,
            }));
        }
        let inside = Rect { left: left + 1.0, top: top - 12.0, right: right + 14.0, bottom };
        let mut labels: Vec<Label<'_>> = Vec::new();
        for mark in marks {
            if labels.iter().any(|label| label.text == mark.label) {
                continue;
            }
            let ((x, y), w) = (place(mark), text_width(mark.label));
            let gap = if mark.is_default { 11.0 } else { 7.0 };
            let diagonal = 0.8 * gap;
            let starts = [
                (x + gap, y + 4.0),
                (x + diagonal, y - diagonal),
                (x - gap - w, y + 4.0),
                (x - 0.5 * w, y - gap - 1.0),
                (x - 0.5 * w, y + gap + 9.0),
                (x + diagonal, y + diagonal + 8.0),
                (x - diagonal - w, y - diagonal),
                (x - diagonal - w, y + diagonal + 8.0),
            ];
            let room = |&(x, y): &(f64, f64)| Rect { left: x, top: y - 9.0, right: x + w, bottom: y + 2.0 };
            let free = |start: &(f64, f64)| {
                let room = room(start);
                inside.holds(&room) && !taken.iter().any(|other| other.overlaps(&room))
            };
            if let Some(start) = starts.iter().find(|start| free(start)) {
                taken.push(room(start));
                labels.push(Label { x: start.0, y: start.1, text: mark.label });
            }
        }
        labels
    }
}

struct Label<'a> {
    x: f64,
    y: f64,
    text: &'a str,
}

struct Rect {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

impl Rect {
    fn overlaps(&self, other: &Self) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }

    fn holds(&self, other: &Self) -> bool {
        self.left <= other.left
            && other.right <= self.right
            && self.top <= other.top
            && other.bottom <= self.bottom
    }
}

/// About how wide a text is.
fn text_width(text: &str) -> f64 {
    5.7 * text.chars().count() as f64
}

fn color(series: usize) -> String {
    format!("color: var(--{})", COLORS[series % COLORS.len()])
}

/// An axis with some room on both sides of what is above zero: logarithmic if that spans more than a factor of ten.
fn spanning(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Axis {
    let usable = values.filter(|v| v.is_finite() && *v > 0.0);
    let (low, high) = usable.fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
    let (low, high) = if low <= high { (low, high) } else { (1.0, 1.0) };
    if high > 10.0 * low {
        let room = (high / low).powf(0.08);
        return Axis { low: low / room, high: high * room, log: true, from, to };
    }
    let room = (0.1 * (high - low)).max(0.02 * high);
    Axis { low: low - room, high: high + room, log: false, from, to }
}

fn scale(axis: &Axis) -> &'static str {
    if axis.log { " (logarithmic)" } else { "" }
}

/// The corners of a line down the front, by steps: a setting stands for all that may cost more.
fn front(series: &Series<'_>, place: &impl Fn(&Mark<'_>) -> (f64, f64)) -> Vec<(f64, f64)> {
    let mut marks: Vec<&Mark<'_>> = series.drawn().filter(|mark| mark.on_front).collect();
    marks.sort_by(|a, b| a.x.total_cmp(&b.x));
    let mut corners: Vec<(f64, f64)> = Vec::new();
    for (x, y) in marks.into_iter().map(place) {
        corners.extend(corners.last().map(|&(_, above)| (x, above)));
        corners.push((x, y));
    }
    corners
}

fn path(corners: &[(f64, f64)]) -> String {
    let to = |i| if i == 0 { 'M' } else { 'L' };
    corners.iter().enumerate().map(|(i, &(x, y))| format!("{}{} {}", to(i), c(x), c(y))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zeros_nan_and_crowds_are_drawn_without_overlap() {
        let mark = |x, y, label| Mark {
            x,
            y,
            label,
            on_front: y == 0.0,
            is_default: x == 1.0,
            hover: String::new(),
        };
        let crowd = (0..30).map(|i| mark(1.0 + 0.01 * f64::from(i), 2.0, "a & long name"));
        let marks = crowd.chain([mark(3.0, 0.0, "zero"), mark(f64::NAN, 1.0, "none")]).collect();
        let scatter = Scatter {
            title: "a < b",
            x_label: "time, ms".to_owned(),
            y_label: "error".to_owned(),
            series: vec![Series { name: "", marks }, Series { name: "other", marks: Vec::new() }],
        };
        let svg = scatter.svg((0.0, 0.0)).into_string();
        assert!(svg.contains("a &lt; b") && svg.contains(">zero<") && !svg.contains("NaN"), "{svg}");
        assert_eq!(svg.matches(">a &amp; long name<").count(), 1);
    }

    #[test]
    fn small_numbers_keep_their_digits() {
        assert_eq!([0.0, 1e-7, 0.0123, 12.34].map(precise), ["0", "1.0e-7", "0.012", "12.3"]);
        assert_eq!([1e-7, 2.5e-8, 0.003, 20.0].map(tick), ["1e-7", "2.5e-8", "0.003", "20"]);
    }
}
