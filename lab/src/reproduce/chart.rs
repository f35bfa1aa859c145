//! Charts as SVG, drawn by `plotters`: lines, bars in groups, and scattered marks, each with a
//! legend beside it.

use std::ops::Range;

use anyhow::Result;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::prelude::*;

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
        Self { x, y, ..Self::default() }
    }

    fn is_drawn(&self) -> bool {
        self.x.is_finite() && self.y.is_finite()
    }
}

/// Width and height of a panel, and the width of a legend, in pixels.
const PANEL: (u32, u32) = (520, 310);
const LEGEND: u32 = 190;
/// Where a legend begins, and most pixels from one name to the next.
const LEGEND_TOP: u32 = 24;
const LEGEND_STEP: usize = 18;

/// Panels in rows of `columns`, with one legend to the right for all names in them.
pub(crate) fn figure(charts: &[Chart], columns: u32) -> Result<String> {
    let mut legend: Vec<(&str, usize)> = Vec::new();
    for series in charts.iter().flat_map(|chart| &chart.series) {
        if !series.name.is_empty() && legend.iter().all(|(name, _)| *name != series.name) {
            legend.push((&series.name, series.color));
        }
    }
    let rows = (charts.len() as u32).div_ceil(columns);
    let width = columns * PANEL.0 + if legend.is_empty() { 0 } else { LEGEND };
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (width, rows * PANEL.1)).into_drawing_area();
        root.fill(&WHITE)?;
        let (panels, side) = root.split_horizontally(columns * PANEL.0);
        for (area, chart) in panels.split_evenly((rows as usize, columns as usize)).iter().zip(charts) {
            chart.draw(area)?;
        }
        // Many names stand closer together.
        let room = (rows * PANEL.1).saturating_sub(LEGEND_TOP) as usize;
        let step = (room / legend.len().max(1)).clamp(1, LEGEND_STEP);
        for (y, (name, color)) in (LEGEND_TOP as i32..).step_by(step).zip(legend) {
            side.draw(&Rectangle::new([(4, y), (22, y + 8)], Palette99::pick(color).filled()))?;
            side.draw(&Text::new(name.to_owned(), (28, y - 2), ("sans-serif", 13)))?;
        }
        root.present()?;
    }
    Ok(svg.trim_end().to_owned())
}

impl Chart {
    fn draw(&self, area: &DrawingArea<SVGBackend<'_>, Shift>) -> Result<()> {
        let points = || self.series.iter().flat_map(|series| &series.points).filter(|point| point.is_drawn());
        let is_scattered = self.series.iter().any(|series| series.kind == Kind::Marks);
        let x = match (self.places.len(), is_scattered) {
            (0, true) => Axis::around(points().map(|point| point.x)),
            (0, false) => Axis { log: false, low: 0.0, high: points().map(|p| p.x).fold(1e-9, f64::max) },
            (places, _) => Axis { log: false, low: -0.1, high: places as f64 },
        };
        let heights = points().flat_map(|p| [p.y, p.low, p.high]).filter(|&y| y > 0.0);
        let y = if is_scattered { Axis::around(heights) } else { Axis::from_zero(heights) };
        let x_ticks = if self.places.is_empty() {
            x.ticks()
        } else {
            (0..self.places.len()).map(|i| i as f64 + 0.4).collect()
        };
        let mut chart = ChartBuilder::on(area)
            .caption(&self.title, ("sans-serif", 15))
            .margin(8)
            .margin_right(16)
            .x_label_area_size(36)
            .y_label_area_size(62)
            .build_cartesian_2d(
                Places { range: x.place(x.low)..x.place(x.high), ticks: x_ticks },
                Places { range: y.place(y.low)..y.place(y.high), ticks: y.ticks() },
            )?;
        let name = |at: &f64| match self.places.get(at.max(0.0) as usize) {
            Some(place) => place.clone(),
            None => tick(x.value(*at)),
        };
        let scale = |axis: &Axis| if axis.log { " (logarithmic)" } else { "" };
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(BLACK.mix(0.12))
            .label_style(("sans-serif", 12))
            .x_desc(format!("{}{}", self.x_label, scale(&x)))
            .y_desc(format!("{}{}", self.y_label, scale(&y)))
            .x_label_formatter(&name)
            .y_label_formatter(&|at| tick(y.value(*at)))
            .draw()?;
        let (bottom, top) = (y.place(y.low), y.place(y.high));
        for rule in self.rules.iter().map(|&at| x.place(at)) {
            chart.draw_series([PathElement::new([(rule, bottom), (rule, top)], BLACK.mix(0.3))])?;
        }
        let mut labelled: Vec<(i32, i32)> = Vec::new();
        for (i, series) in self.series.iter().enumerate() {
            let color = Palette99::pick(series.color).to_rgba();
            let drawn = || series.points.iter().filter(|point| point.is_drawn());
            let at = |point: &Point| (x.place(point.x), y.place(point.y));
            match series.kind {
                Kind::Line => {
                    chart.draw_series(LineSeries::new(drawn().map(at), color.stroke_width(2)))?;
                }
                Kind::Bars => {
                    let width = 0.8 / self.series.len() as f64;
                    let left = |point: &Point| point.x + width * i as f64;
                    chart.draw_series(drawn().map(|point| {
                        let (from, to) = (left(point), left(point) + 0.85 * width);
                        Rectangle::new([(from, bottom), (to, y.place(point.y))], color.filled())
                    }))?;
                    chart.draw_series(drawn().map(|point| {
                        let middle = left(point) + 0.42 * width;
                        PathElement::new([(middle, y.place(point.low)), (middle, y.place(point.high))], BLACK)
                    }))?;
                }
                Kind::Marks => {
                    let mut front: Vec<_> = drawn().filter(|point| point.is_filled).map(at).collect();
                    front.sort_by(|a, b| a.0.total_cmp(&b.0));
                    chart.draw_series(LineSeries::new(front, color.mix(0.6)))?;
                    let dot = |point: &Point| {
                        let style = if point.is_filled { color.filled() } else { color.stroke_width(1) };
                        Circle::new(at(point), 4, style)
                    };
                    chart.draw_series(drawn().map(dot))?;
                    let ringed = drawn().filter(|point| point.is_ringed);
                    chart.draw_series(ringed.map(|point| Circle::new(at(point), 8, color)))?;
                    // A name is written if no other name is in its way.
                    for point in drawn().filter(|point| point.is_filled || point.is_ringed) {
                        let place = chart.backend_coord(&at(point));
                        let clear = |other: &(i32, i32)| {
                            (other.1 - place.1).abs() > 12 || (other.0 - place.0).abs() > 130
                        };
                        if labelled.iter().all(clear) {
                            labelled.push(place);
                            let text = EmptyElement::at(at(point))
                                + Text::new(point.label.clone(), (10, -6), ("sans-serif", 11));
                            chart.draw_series([text])?;
                        }
                    }
                }
            }
        }
        Ok(())
    }
}

/// Coordinates along an axis, with ticks where this module wants them: `plotters` has none that are
/// round on a logarithmic scale.
struct Places {
    range: Range<f64>,
    ticks: Vec<f64>,
}

impl Ranged for Places {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        let part = (value - self.range.start) / (self.range.end - self.range.start);
        from + (part * f64::from(to - from)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

/// The values of an axis.
struct Axis {
    low: f64,
    high: f64,
    log: bool,
}

impl Axis {
    /// Linear from zero; logarithmic if the positive values span more than a factor of 20.
    fn from_zero(values: impl Iterator<Item = f64>) -> Self {
        let (low, high) = values.fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
        match high {
            0.0 => Self { low: 0.0, high: 1.0, log: false },
            _ if high > 20.0 * low => Self { low: 0.7 * low, high: 1.3 * high, log: true },
            _ => Self { low: 0.0, high: 1.08 * high, log: false },
        }
    }

    /// With some room on both sides of the positive values; logarithmic if they span more than a
    /// factor of ten.
    fn around(values: impl Iterator<Item = f64>) -> Self {
        let usable = values.filter(|&v| v > 0.0);
        let (low, high) = usable.fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
        if low > high {
            return Self { low: 0.0, high: 1.0, log: false };
        }
        let (log, room) = (high > 10.0 * low, (0.1 * (high - low)).max(0.02 * high));
        if log {
            Self { low: 0.7 * low, high: 1.6 * high, log }
        } else {
            Self { low: low - room, high: high + room, log }
        }
    }

    /// The coordinate of a value; what a logarithm cannot show stands at the lower end.
    fn place(&self, value: f64) -> f64 {
        if self.log { value.max(self.low).log10() } else { value }
    }

    fn value(&self, place: f64) -> f64 {
        if self.log { 10f64.powf(place) } else { place }
    }

    /// Places of round values: some multiples of powers of ten.
    fn ticks(&self) -> Vec<f64> {
        let decades = (self.high / self.low).log10();
        if self.log {
            let steps: &[f64] = if decades > 3.5 { &[1.0] } else { &[1.0, 2.0, 5.0] };
            let powers = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
            let all = powers.flat_map(|e| steps.iter().map(move |s| s * 10f64.powi(e)));
            return all.filter(|t| (self.low..=self.high).contains(t)).map(f64::log10).collect();
        }
        let rough = (self.high - self.low) / 5.0;
        let decade = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * decade).into_iter().find(|&s| s >= rough);
        let step = step.unwrap_or(10.0 * decade);
        let first = (self.low / step).ceil();
        (0..12).map(|i| (first + f64::from(i)) * step).take_while(|&t| t <= self.high).collect()
    }
}

/// A number as short as it may be: three digits, thousands set apart.
pub(crate) fn number(value: f64) -> String {
    let magnitude = value.abs();
    let decimals = match magnitude {
        _ if !value.is_finite() => return "–".to_owned(),
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

/// A number as short as it may be, powers of ten split off where it is small.
pub(crate) fn precise(value: f64) -> String {
    if value != 0.0 && value.abs() < 0.01 { format!("{value:.1e}") } else { number(value) }
}

/// A tick's number, without needless zeros.
fn tick(value: f64) -> String {
    let text = precise(value).replace(".0e", "e");
    let trimmed = text.trim_end_matches('0').trim_end_matches('.');
    if text.contains('.') && !text.contains('e') { trimmed.to_owned() } else { text }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let texts = [0.0, 0.5, 1.234, 12.34, 123.4, 12_345.0, -1234.0, f64::NAN].map(number);
        assert_eq!(texts, ["0", "0.500", "1.23", "12.3", "123", "12\u{202f}345", "-1\u{202f}234", "–"]);
        assert_eq!((precise(0.0012), tick(2.0), tick(0.001)), ("1.2e-3".into(), "2".into(), "1e-3".into()));
    }

    #[test]
    fn ticks_are_round_and_inside() {
        let linear = Axis { low: 0.0, high: 9.3, log: false };
        assert_eq!(linear.ticks(), [0.0, 2.0, 4.0, 6.0, 8.0]);
        let log = Axis { low: 0.8, high: 30.0, log: true };
        let values: Vec<f64> = log.ticks().iter().map(|&t| log.value(t).round()).collect();
        assert_eq!(values, [1.0, 2.0, 5.0, 10.0, 20.0]);
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
                let svg = figure(&[chart], 1).unwrap();
                assert!(svg.starts_with("<svg") && svg.ends_with("</svg>") && !svg.contains("NaN"), "{svg}");
                assert!(svg.contains(mark) && svg.contains(">\nname\n<"), "{svg}");
            }
        }
    }
}
