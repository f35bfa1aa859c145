//! Charts as SVG: lines, bars in groups, and scattered marks, each with a legend beside it.
//!
//! Written here, in as many lines as it took with the crate plotters: with that, nothing drawn
//! could bear the name of its strategy, by which the page links charts and tables.

use std::collections::HashSet;
use std::fmt;

use indicatif::{HumanCount, HumanFloatCount};

/// One panel.
#[derive(Default)]
pub(crate) struct Chart {
    pub(crate) title: String,
    pub(crate) x_label: String,
    pub(crate) y_label: String,
    pub(crate) series: Vec<Series>,
    /// Names of the places 0, 1, 2 ... on the horizontal axis, where it has names instead of
    /// numbers.
    pub(crate) places: Vec<String>,
    /// Where to rule vertical lines.
    pub(crate) rules: Vec<f64>,
}

/// Points of one name and colour.
pub(crate) struct Series {
    pub(crate) name: String,
    /// Index into the palette.
    pub(crate) color: usize,
    pub(crate) kind: Kind,
    pub(crate) points: Vec<Point>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Line,
    /// Heights at places, each with the range from `low` to `high` as a thin line.
    Bars,
    /// Marks; the filled ones joined by a line.
    Marks,
}

#[derive(Clone, Default)]
pub(crate) struct Point {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) label: String,
    pub(crate) is_filled: bool,
    pub(crate) is_ringed: bool,
}

impl Point {
    pub(crate) fn at(x: f64, y: f64) -> Self {
        Self { x, y, low: y, high: y, ..Self::default() }
    }
}

/// Width and height of a panel, and the left, top, right and bottom of the plot in it, in pixels.
const PANEL: [f64; 2] = [520.0, 310.0];
const PLOT: [f64; 4] = [70.0, 46.0, 504.0, 270.0];
/// Most pixels of a letter, as a mean over a name.
const LETTER: f64 = 7.0;
/// Where a legend begins, and most pixels from one name to the next.
const LEGEND_TOP: f64 = 24.0;
const LEGEND_STEP: f64 = 18.0;

/// Panels in rows of `columns`, with one legend to the right for all names in them.
pub(crate) fn figure(charts: &[Chart], columns: usize) -> String {
    let mut names = HashSet::new();
    let mut legend: Vec<&Series> = charts.iter().flat_map(|chart| &chart.series).collect();
    legend.retain(|series| !series.name.is_empty() && names.insert(&series.name));
    let side = columns as f64 * PANEL[0];
    let width = side + legend.iter().map(|s| 30.0 + LETTER * s.name.len() as f64).fold(0.0, f64::max).ceil();
    let height = charts.len().div_ceil(columns) as f64 * PANEL[1];
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    for (i, chart) in charts.iter().enumerate() {
        let (x, y) = (PANEL[0] * (i % columns) as f64, PANEL[1] * (i / columns) as f64);
        svg += &format!("<g transform=\"translate({x} {y})\">\n{}</g>\n", chart.draw());
    }
    // Many names stand closer together.
    let step = ((height - LEGEND_TOP) / legend.len().max(1) as f64).clamp(1.0, LEGEND_STEP);
    for (series, i) in legend.into_iter().zip(0..) {
        let (x, y, color) = (side + 4.0, LEGEND_TOP + step * f64::from(i), color(series));
        let name = text(&series.name, [x + 24.0, y + 8.0], "start");
        svg += &format!(
            "<g{}><rect x=\"{x}\" y=\"{y:.1}\" width=\"18\" height=\"8\" fill=\"{color}\"/>{name}</g>\n",
            series.named()
        );
    }
    svg + "</svg>"
}

/// The colours of `report.css` for the strategies of the report's first screen. Others differ from
/// those before, by the golden angle.
fn color(series: &Series) -> String {
    // In figure 5 the speed follows the name.
    let strategy = series.name.trim_start_matches("pivot ").split(", ").next();
    match strategy.unwrap_or_default() {
        "refit" => "#c8640a".to_owned(),
        "refit+rotate" => "#1a7f4b".to_owned(),
        "auto" => "#1a5fb4".to_owned(),
        _ => {
            let (hue, lightness) = (137.508 * series.color as f64 % 360.0, [38, 52, 64][series.color % 3]);
            format!("hsl({hue:.0},70%,{lightness}%)")
        }
    }
}

fn text(words: &str, [x, y]: [f64; 2], anchor: &str) -> String {
    let words = escaped(words);
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{words}</text>\n")
}

fn escaped(words: &str) -> String {
    words.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

fn line([x, y]: [f64; 2], [to_x, to_y]: [f64; 2], opacity: f64) -> String {
    format!("<path d=\"M{x:.1} {y:.1}L{to_x:.1} {to_y:.1}\" stroke=\"black\" opacity=\"{opacity}\"/>\n")
}

fn circle([x, y]: [f64; 2], radius: u32, fill: &str) -> String {
    format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{fill}\"/>\n")
}

impl Series {
    /// The points that have a place.
    fn drawn(&self) -> impl Iterator<Item = &Point> {
        self.points.iter().filter(|point| point.x.is_finite() && point.y.is_finite())
    }

    /// The attribute by which the page finds what is drawn of it.
    fn named(&self) -> String {
        format!(" data-strategy=\"{}\"", escaped(&self.name))
    }

    /// A line through places in the panel.
    fn joined(&self, places: &[[f64; 2]], style: &str) -> String {
        let places: Vec<_> = places.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let (points, color) = (places.join(" "), color(self));
        format!("<polyline{} points=\"{points}\" fill=\"none\" stroke=\"{color}\" {style}/>\n", self.named())
    }

    /// Marks, with names where no other of `labelled` is in the way.
    fn marks(&self, at: impl Fn(f64, f64) -> [f64; 2], labelled: &mut Vec<[f64; 3]>) -> String {
        let front = self.drawn().filter(|point| point.is_filled);
        let mut front: Vec<_> = front.map(|point| at(point.x, point.y)).collect();
        front.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut svg = self.joined(&front, "opacity=\"0.6\"");
        svg += &format!("<g{} stroke=\"{}\">", self.named(), color(self));
        for point in self.drawn() {
            let fill = if point.is_filled { &color(self) } else { "none" };
            svg += &circle(at(point.x, point.y), 4, fill);
            if point.is_ringed {
                svg += &circle(at(point.x, point.y), 8, "none");
            }
        }
        svg += "</g>\n";
        for point in self.drawn().filter(|point| point.is_filled || point.is_ringed) {
            let [x, y] = at(point.x, point.y);
            let width = LETTER * point.label.len() as f64;
            let start = (x + 10.0).min(PANEL[0] - width);
            let end = start + width;
            if labelled.iter().all(|other| (other[2] - y).abs() > 12.0 || other[0] > end || other[1] < start)
            {
                labelled.push([start, end, y]);
                svg += &text(&point.label, [start, y - 7.0], "start");
            }
        }
        svg
    }
}

impl Chart {
    fn draw(&self) -> String {
        let points = || self.series.iter().flat_map(Series::drawn);
        let is_scattered = self.series.iter().any(|series| series.kind == Kind::Marks);
        let x = match (self.places.len(), is_scattered) {
            (0, true) => Axis::of(points().map(|point| point.x), true),
            (0, false) => Axis { high: points().map(|p| p.x).fold(1e-9, f64::max), ..Axis::default() },
            (places, _) => Axis { low: -0.1, high: places as f64, ..Axis::default() },
        };
        let y = Axis::of(points().flat_map(|p| [p.y, p.low, p.high]), is_scattered);
        let [left, top, right, bottom] = PLOT;
        let at =
            |px: f64, py: f64| [left + x.part(px) * (right - left), bottom - y.part(py) * (bottom - top)];
        let mut svg = self.axes(&x, &y, at);
        let mut labelled = Vec::new();
        for (i, series) in self.series.iter().enumerate() {
            match series.kind {
                Kind::Line => {
                    let places: Vec<_> = series.drawn().map(|point| at(point.x, point.y)).collect();
                    svg += &series.joined(&places, "stroke-width=\"2\"");
                }
                Kind::Bars => {
                    let width = 0.8 / self.series.len() as f64;
                    svg += &format!("<g{} fill=\"{}\">", series.named(), color(series));
                    for point in series.drawn() {
                        let from = point.x + width * i as f64;
                        let ([x, y], [to, _]) = (at(from, point.y), at(from + 0.85 * width, point.y));
                        let (wide, high) = (to - x, bottom - y);
                        svg += &format!(
                            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{wide:.1}\" height=\"{high:.1}\"/>\n"
                        );
                        let middle = from + 0.42 * width;
                        svg += &line(at(middle, point.low), at(middle, point.high), 1.0);
                    }
                    svg += "</g>\n";
                }
                Kind::Marks => svg += &series.marks(at, &mut labelled),
            }
        }
        svg
    }

    /// Title, ticks with their lines, names of the axes, and rules.
    fn axes(&self, x: &Axis, y: &Axis, at: impl Fn(f64, f64) -> [f64; 2]) -> String {
        let [left, top, right, bottom] = PLOT;
        let middle = 0.5 * (left + right);
        let mut svg = text(&self.title, [middle, top - 30.0], "middle");
        for tick in y.ticks() {
            let [_, height] = at(x.low, tick);
            svg += &line([left, height], [right, height], 0.12);
            svg += &text(&short(tick), [left - 6.0, height + 4.0], "end");
        }
        for (place, name) in self.places.iter().enumerate() {
            // A name wider than its place goes on in a second line after a hyphen.
            let is_wide = LETTER * name.len() as f64 > (right - left) / (x.high - x.low);
            let (first, rest) =
                name.split_at(name.find('-').filter(|_| is_wide).map_or(name.len(), |at| at + 1));
            for (part, line) in [first, rest].into_iter().zip([16.0, 30.0]) {
                svg += &text(part, [at(place as f64 + 0.4, y.low)[0], bottom + line], "middle");
            }
        }
        for tick in x.ticks().into_iter().filter(|_| self.places.is_empty()) {
            let [place, _] = at(tick, y.low);
            svg += &line([place, top], [place, bottom], 0.12);
            svg += &text(&short(tick), [place, bottom + 16.0], "middle");
        }
        let label =
            |name: &str, axis: &Axis| format!("{name}{}", if axis.log { " (logarithmic)" } else { "" });
        svg += &text(&label(&self.x_label, x), [middle, bottom + 34.0], "middle");
        svg += &text(&label(&self.y_label, y), [10.0, top - 12.0], "start");
        for &rule in &self.rules {
            svg += &line([at(rule, y.low)[0], top], [at(rule, y.low)[0], bottom], 0.3);
        }
        svg + &line([left, bottom], [right, bottom], 1.0) + &line([left, top], [left, bottom], 1.0)
    }
}

/// The values of an axis.
#[derive(Default)]
struct Axis {
    low: f64,
    high: f64,
    log: bool,
    /// Whether there are zeros: a logarithmic axis has them at its lower end.
    zero: bool,
}

impl Axis {
    /// Logarithmic if the positive values span more than a factor of 20, or of 10 where they are
    /// scattered; else from zero, or with some room on both sides.
    fn of(values: impl Iterator<Item = f64>, are_scattered: bool) -> Self {
        let mut zero = false;
        let positive = values.inspect(|&v| zero |= v == 0.0).filter(|&v| v > 0.0);
        let (low, high) = positive.fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
        // Zeros stand apart from the least value.
        let bottom = if zero { 0.2 } else { 0.7 };
        let (low, high, log) = match are_scattered {
            _ if low > high => (0.0, 1.0, false),
            true if high > 10.0 * low => (bottom * low, 1.6 * high, true),
            false if high > 20.0 * low => (bottom * low, 1.3 * high, true),
            true => {
                let low = if zero { 0.0 } else { low };
                let room = (0.1 * (high - low)).max(0.02 * high);
                (low - room, high + room, false)
            }
            false => (0.0, 1.08 * high, false),
        };
        Self { low, high, log, zero }
    }

    /// Where a value is between the ends of the axis; what is below stands at the lower end.
    fn part(&self, value: f64) -> f64 {
        let place = |value: f64| if self.log { value.max(self.low).log10() } else { value.max(self.low) };
        (place(value) - place(self.low)) / (place(self.high) - place(self.low))
    }

    /// Round values: some multiples of powers of ten.
    fn ticks(&self) -> Vec<f64> {
        let inside = |tick: &f64| (self.low..=self.high).contains(tick);
        if self.log {
            let decades = (self.high / self.low).log10();
            let steps: &[f64] = if decades > 3.5 { &[1.0] } else { &[1.0, 2.0, 5.0] };
            let powers = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
            let ticks = powers.flat_map(|e| steps.iter().map(move |s| s * 10f64.powi(e))).filter(inside);
            // The tick of zero needs room.
            let (zero, least) = if self.zero { (Some(0.0), 2.5 * self.low) } else { (None, self.low) };
            return zero.into_iter().chain(ticks.filter(|&tick| tick >= least)).collect();
        }
        let rough = (self.high - self.low) / 5.0;
        let decade = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0].map(|m| m * decade).into_iter().find(|&s| s >= rough);
        let step = step.unwrap_or(10.0 * decade);
        let first = (self.low / step).ceil();
        (0..12).map(|i| (first + f64::from(i)) * step).take_while(inside).collect()
    }
}

/// A number as short as it may be: three digits, thousands set apart.
pub(crate) fn number(value: f64) -> String {
    let magnitude = value.abs();
    let decimals = match magnitude {
        _ if !value.is_finite() => return "–".to_owned(),
        m if m >= 999.5 => return thousands(HumanFloatCount(value)),
        m if m >= 99.95 || m == 0.0 => 0,
        m if m >= 9.995 => 1,
        m if m >= 0.9995 => 2,
        _ => 3,
    };
    format!("{value:.decimals$}")
}

/// How many of something.
pub(crate) fn count(n: u64) -> String {
    thousands(HumanCount(n))
}

/// A number as short as it may be, powers of ten split off where it is small.
pub(crate) fn precise(value: f64) -> String {
    if value != 0.0 && value.abs() < 0.01 { format!("{value:.1e}") } else { number(value) }
}

/// A tick's number, without needless zeros.
fn short(value: f64) -> String {
    let text = precise(value).replace(".0e", "e");
    let trimmed = text.trim_end_matches('0').trim_end_matches('.');
    if text.contains('.') && !text.contains('e') { trimmed.to_owned() } else { text }
}

/// A whole number in groups of three digits, apart from one another.
fn thousands(number: impl fmt::Display) -> String {
    format!("{number:.0}").replace(',', "\u{202f}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let texts = [0.0, 0.5, 1.234, 12.34, 123.4, 12_345.0, -1234.0, f64::NAN].map(number);
        assert_eq!(texts, ["0", "0.500", "1.23", "12.3", "123", "12\u{202f}345", "-1\u{202f}234", "–"]);
        assert_eq!(number(-123_456.0), "-123\u{202f}456");
        assert_eq!(count(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!((precise(0.0012), short(2.0), short(0.001)), ("1.2e-3".into(), "2".into(), "1e-3".into()));
    }

    #[test]
    fn ticks_are_round_and_inside() {
        let linear = Axis { high: 9.3, ..Axis::default() };
        assert_eq!(linear.ticks(), [0.0, 2.0, 4.0, 6.0, 8.0]);
        let log = Axis { low: 0.8, high: 30.0, log: true, zero: false };
        let values: Vec<f64> = log.ticks().iter().map(|&t| t.round()).collect();
        assert_eq!(values, [1.0, 2.0, 5.0, 10.0, 20.0]);
        let zero = Axis::of([0.0, 4.0, 100.0].into_iter(), true);
        assert_eq!((zero.ticks()[..2].to_vec(), zero.part(0.0)), (vec![0.0, 2.0], 0.0));
    }

    #[test]
    fn every_kind_is_drawn_even_without_a_finite_value() {
        let series = |kind, y| Series {
            name: "name".to_owned(),
            color: 0,
            kind,
            points: vec![Point { label: "label".to_owned(), is_filled: true, ..Point::at(1.0, y) }],
        };
        for (kind, mark) in [(Kind::Line, "polyline"), (Kind::Bars, "rect"), (Kind::Marks, "circle")] {
            for y in [3.0, 0.0, f64::NAN] {
                let chart = Chart { series: vec![series(kind, y), series(kind, 400.0)], ..Chart::default() };
                let svg = figure(&[chart], 1);
                assert!(svg.starts_with("<svg") && svg.ends_with("</svg>") && !svg.contains("NaN"), "{svg}");
                assert!(svg.contains(mark) && svg.contains(">name<"), "{svg}");
            }
        }
    }
}
