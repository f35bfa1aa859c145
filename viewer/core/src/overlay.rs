//! What is drawn over the picture: boxes, titles, the panel, graphs and the timeline.

use crate::boxes::{self, Projection, growth_color};
use crate::canvas::{Canvas, Color, LETTER, Rect};
use crate::controls::{CONTROLS, SLIDERS};
use crate::side::{Sample, Side};
use crate::state::{Shown, State};

const WHITE: Color = [255; 3];
const GRAY: Color = [170; 3];
const DARK: Color = [16, 18, 24];
const FLASH: Color = [255, 255, 90];
const PICKED: Color = [90, 200, 255];
/// Colours of the tree on the left and on the right.
const SIDES: [Color; 2] = [[255, 150, 60], [80, 220, 120]];

const LINE: i32 = LETTER.1 + 2;
const PANEL: i32 = 39 * LETTER.0;
/// Where values begin in it.
const VALUE: i32 = 4 + 22 * LETTER.0;
const GRAPH: i32 = 72;
const TIMELINE: i32 = 10;

impl State {
    /// The row of a control in the panel. Behind the row of a slider there is one for what it
    /// costs.
    pub(crate) fn row(i: usize) -> Rect {
        let prices = CONTROLS.iter().take(i).filter(|(.., control)| SLIDERS.contains(control)).count();
        Rect { x: 0, y: 4 + LINE * (i + prices) as i32, width: PANEL, height: LINE }
    }

    /// The part of a control's row that its value stands in: the track of a slider.
    pub(crate) fn track(row: Rect) -> Rect {
        Rect { x: VALUE, width: PANEL - VALUE - 4, ..row }
    }

    /// Where the frame is chosen.
    pub(crate) fn timeline(&self) -> Rect {
        let (Some(last), true) = (self.ports().pop(), self.settings.overlay > 0) else {
            return Rect::default();
        };
        Rect { x: 0, y: last.height - TIMELINE, width: last.x + last.width, height: TIMELINE }
    }

    pub(crate) fn draw_overlay(&mut self) {
        self.on_canvas(|state, canvas| {
            if let Some(shown) = &state.shown {
                for (side, port) in shown.sides.iter().zip(state.ports()) {
                    state.draw_boxes(canvas, shown, side, port);
                }
            }
            if state.settings.overlay > 0 {
                state.draw_titles(canvas);
                state.draw_graphs(canvas);
            }
            if state.settings.overlay > 1 {
                state.draw_panel(canvas);
            }
        });
    }

    fn draw_boxes(&self, canvas: &mut Canvas, shown: &Shown, side: &Side, port: Rect) {
        if side.frame != shown.frame {
            return;
        }
        let projection = Projection::new(&self.camera(&shown.stage, port, 1), port);
        if let Some(depth) = self.settings.boxes {
            let mut boxes = boxes::at_depth(&side.tree, depth, &shown.typical);
            // The worst are drawn last, over the others.
            boxes.sort_by(|(_, a), (_, b)| a.total_cmp(b));
            for (aabb, growth) in &boxes {
                projection.draw(canvas, aabb, growth_color(*growth), 0.7);
            }
        }
        if self.settings.flash {
            side.flashes.iter().for_each(|aabb| projection.draw(canvas, aabb, FLASH, 0.8));
        }
        if let Some(primitive) = self.picked {
            let path = boxes::path(&side.tree, primitive, &shown.triangle(primitive));
            for (i, aabb) in path.iter().enumerate() {
                let alpha = 0.25 + 0.75 * (i + 1) as f32 / path.len() as f32;
                projection.draw(canvas, aabb, PICKED, alpha);
            }
        }
    }

    fn draw_titles(&self, canvas: &mut Canvas) {
        let Some(shown) = &self.shown else {
            let text = self.hint();
            canvas.fill(
                Rect { x: 0, y: 0, width: canvas.width as i32, height: canvas.height as i32 },
                DARK,
                1.0,
            );
            return canvas.text(PANEL + LETTER.0, canvas.height as i32 / 2, &text, WHITE);
        };
        for (i, (side, port)) in shown.sides.iter().zip(self.ports()).enumerate() {
            let mut lines = self.figures(shown, side);
            lines.truncate(port.height as usize / (2 * LINE as usize));
            let width = lines.iter().map(|line| line.len() as i32).max().unwrap_or(0) * LETTER.0 + 8;
            let rect =
                Rect { x: port.x + port.width - width, y: 0, width, height: 4 + LINE * lines.len() as i32 };
            canvas.fill(rect, DARK, 0.6);
            for (k, line) in lines.iter().enumerate() {
                let color = [SIDES[i % 2], WHITE, GRAY][k.min(2)];
                canvas.text(rect.x + 4, 3 + LINE * k as i32, line, color);
            }
            if i > 0 {
                canvas.fill(Rect { x: port.x, y: 0, width: 1, height: port.height }, DARK, 1.0);
            }
        }
        // Where there is a panel, it has this line.
        if self.settings.overlay == 1 && (self.is_loading() || !self.message.is_empty()) {
            let (hint, line) = (self.hint(), self.timeline());
            let y = line.y - GRAPH - LINE - 2;
            canvas.fill(Rect { y, height: LINE, ..line }, DARK, 0.75);
            canvas.text(line.x + 4, y + 1, &hint, FLASH);
        }
    }

    /// What is said of a tree, line by line.
    fn figures(&self, shown: &Shown, side: &Side) -> Vec<String> {
        let sample = side.sample(shown.frame);
        let mut title = side.strategy.name().to_owned();
        if let Some(fresh) = shown.fresh_cost(shown.frame).filter(|&fresh| fresh > 0.0) {
            title += &format!("  cost {:.2} x fresh", f64::from(sample.cost) / fresh);
        }
        let mut lines =
            vec![title, format!("update {:.1} ms, trace {:.1} ms", sample.update_ms, side.trace_ms)];
        if side.coarse_now > 1 {
            lines.push(format!("a ray for {0}x{0} pixels", side.coarse_now));
        }
        if self.settings.heat {
            lines.push(format!("heat: nodes visited, white is {}", shown.hottest));
        }
        if let Some(primitive) = self.picked.filter(|_| side.frame == shown.frame) {
            let path = boxes::path(&side.tree, primitive, &shown.triangle(primitive));
            lines.push(format!("triangle {primitive}: {} nodes to its leaf", path.len()));
        }
        let most = if self.settings.overlay > 1 { side.log.len() } else { 0 };
        lines.extend(side.log.iter().take(most).cloned());
        // The panel hides a part of the first tree's picture; where there are two, both have lines
        // of one length.
        let hidden = if self.settings.overlay > 1 { PANEL } else { 0 };
        let widest = (self.ports().first().map_or(0, |port| port.width) - hidden - 8) / LETTER.0;
        lines.iter_mut().for_each(|line| line.truncate(widest.max(1) as usize));
        lines
    }

    fn draw_panel(&self, canvas: &mut Canvas) {
        let bottom = Self::row(CONTROLS.len());
        canvas.fill(Rect { x: 0, y: 0, height: bottom.y + 4, ..bottom }, DARK, 0.75);
        for (i, &(key, label, control)) in CONTROLS.iter().enumerate() {
            let (row, value) = (Self::row(i), self.value(control));
            if row.contains(self.pointer) {
                canvas.fill(row, WHITE, 0.2);
            }
            let key = if key == ' ' { "space".to_owned() } else { key.to_string() };
            canvas.text(4, row.y + 1, &key, FLASH);
            canvas.text(4 + 6 * LETTER.0, row.y + 1, label, GRAY);
            if let Some((at, count)) = self.slider(control) {
                let track = Self::track(row);
                let width = track.width * (at + 1) as i32 / count as i32;
                canvas.fill(Rect { y: row.y + 1, height: LINE - 2, ..track }, GRAY, 0.25);
                canvas.fill(Rect { y: row.y + 1, height: LINE - 2, width, ..track }, PICKED, 0.4);
                canvas.fill(Rect { x: track.x + width - 2, width: 3, ..track }, PICKED, 1.0);
                canvas.text(4, row.y + LINE + 1, &self.price(control), GRAY);
            }
            let value: String = value.chars().take(((PANEL - VALUE) / LETTER.0) as usize).collect();
            canvas.text(VALUE + 2, row.y + 1, &value, WHITE);
        }
        let hint = self.hint();
        let lines = [
            hint.as_str(),
            "refit: boxes grow as triangles scatter",
            "rotate: swaps nodes, boxes stay small",
            "space: stop, and blocks become sharp",
            "drag: turn  wheel: near  click: pick",
            "right drag: look  wasdqe: fly",
            "arrows: one frame  home: restart",
        ];
        for (i, line) in lines.into_iter().enumerate() {
            let line: String = line.chars().take(PANEL as usize / LETTER.0 as usize).collect();
            let y = bottom.y + 5 + LINE * i as i32;
            canvas.fill(Rect { y: y - 1, ..bottom }, DARK, 0.75);
            canvas.text(4, y, &line, if i == 0 { FLASH } else { GRAY });
        }
    }

    fn draw_graphs(&self, canvas: &mut Canvas) {
        let Some(shown) = &self.shown else { return };
        let (line, frames) = (self.timeline(), shown.frames());
        canvas.fill(line, DARK, 0.8);
        let done = (shown.frame as i64 * i64::from(line.width) / (frames as i64 - 1).max(1)) as i32;
        canvas.fill(Rect { width: done.max(2), ..line }, PICKED, 0.7);
        let text = format!("frame {} of {frames}", shown.frame);
        canvas.text(line.x + 4, line.y, &text, WHITE);

        let fresh = |frame| shown.fresh_cost(frame).filter(|&cost| cost > 0.0);
        let ratio = |frame, sample: &Sample| fresh(frame).map_or(0.0, |fresh| sample.cost / fresh as f32);
        type Value<'a> = &'a dyn Fn(usize, &Sample) -> f32;
        let graphs: [(&str, Value<'_>); 3] = [
            ("update, ms", &|_, sample| sample.update_ms),
            ("trace, ns a ray", &|_, sample| sample.trace_ns),
            ("cost over fresh", &ratio),
        ];
        let width = line.width / 3;
        for (i, (label, value)) in graphs.into_iter().enumerate() {
            let rect =
                Rect { x: line.x + width * i as i32, y: line.y - GRAPH - 1, width: width - 2, height: GRAPH };
            draw_graph(canvas, shown, rect, label, value);
        }
    }
}

/// One line for each tree, over the frames of the animation.
fn draw_graph(
    canvas: &mut Canvas,
    shown: &Shown,
    rect: Rect,
    label: &str,
    value: &dyn Fn(usize, &Sample) -> f32,
) {
    canvas.fill(rect, DARK, 0.75);
    let points = |side: &Side| -> Vec<(usize, f32)> {
        let known = side.samples.iter().enumerate().filter_map(|(i, s)| Some((i, value(i, s.as_ref()?))));
        known.filter(|(_, y)| *y > 0.0 && y.is_finite()).collect()
    };
    let lines: Vec<_> = shown.sides.iter().map(points).collect();
    let top = lines.iter().flatten().map(|(_, y)| *y).fold(0.0, f32::max);
    let last = (shown.frames() - 1).max(1) as f32;
    let at = |frame: usize, y: f32| {
        let inside = (rect.height - LINE - 2) as f32;
        let x = rect.x as f32 + frame as f32 / last * (rect.width - 1) as f32;
        [x, (rect.y + rect.height - 1) as f32 - y / top * inside]
    };
    let now = at(shown.frame, 0.0)[0] as i32;
    canvas.fill(Rect { x: now, width: 1, ..rect }, WHITE, 0.5);
    for (line, color) in lines.iter().zip(SIDES) {
        let mut before = None;
        for &(frame, y) in line {
            let (from, to) = (before.unwrap_or(at(frame, y)), at(frame, y));
            canvas.line(from, to, rect, color, 1.0);
            before = Some(to);
        }
    }
    canvas.text(rect.x + 4, rect.y + 1, &format!("{label}  0 to {top:.1}"), GRAY);
}
