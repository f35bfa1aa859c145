//! Pixels to draw on: lines and boxes that shine through, and text.

use std::convert::Infallible;

use embedded_graphics::Pixel;
use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::iso_8859_1::FONT_6X10;
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::*;
use embedded_graphics::text::{Baseline, Text};

/// Red, green and blue, 8-bit sRGB.
pub(crate) type Color = [u8; 3];

/// Width and height of a character in pixels.
pub(crate) const LETTER: (i32, i32) = (6, 10);

/// A picture in memory: rows from the top, each from the left.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Canvas {
    /// Pixels from left to right.
    pub width: u32,
    /// Pixels from top to bottom.
    pub height: u32,
    /// Red, green, blue and 255 of each pixel.
    pub rgba: Vec<u8>,
}

/// A part of the canvas.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Rect {
    pub(crate) x: i32,
    pub(crate) y: i32,
    pub(crate) width: i32,
    pub(crate) height: i32,
}

impl Rect {
    pub(crate) fn contains(&self, (x, y): (f32, f32)) -> bool {
        let inside = |at: f32, from: i32, length: i32| at >= from as f32 && at < (from + length) as f32;
        inside(x, self.x, self.width) && inside(y, self.y, self.height)
    }
}

impl Canvas {
    pub(crate) fn new(width: u32, height: u32) -> Self {
        Self { width, height, rgba: vec![255; 4 * width as usize * height as usize] }
    }

    /// Mixes a colour into a pixel, all of it with `alpha` 1; nothing beyond the edges.
    fn blend(&mut self, x: i32, y: i32, color: Color, alpha: f32) {
        if x < 0 || y < 0 || x >= self.width as i32 || y >= self.height as i32 {
            return;
        }
        let at = 4 * (y as usize * self.width as usize + x as usize);
        for (to, from) in self.rgba[at..at + 3].iter_mut().zip(color) {
            *to = (f32::from(*to) + (f32::from(from) - f32::from(*to)) * alpha + 0.5) as u8;
        }
    }

    /// Fills a rectangle.
    pub(crate) fn fill(&mut self, rect: Rect, color: Color, alpha: f32) {
        for y in rect.y.max(0)..(rect.y + rect.height).min(self.height as i32) {
            for x in rect.x.max(0)..(rect.x + rect.width).min(self.width as i32) {
                self.blend(x, y, color, alpha);
            }
        }
    }

    /// Draws the part of a line between two points that is within `clip`.
    pub(crate) fn line(&mut self, a: [f32; 2], b: [f32; 2], clip: Rect, color: Color, alpha: f32) {
        let Some((a, b)) = clipped(a, b, clip) else { return };
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let steps = dx.abs().max(dy.abs()).ceil().max(1.0);
        for i in 0..=steps as i32 {
            let s = i as f32 / steps;
            self.blend((a[0] + dx * s) as i32, (a[1] + dy * s) as i32, color, alpha);
        }
    }

    /// Writes one line of text with its upper left corner at a point.
    pub(crate) fn text(&mut self, x: i32, y: i32, text: &str, [r, g, b]: Color) {
        let style = MonoTextStyle::new(&FONT_6X10, Rgb888::new(r, g, b));
        // Drawing on memory cannot fail.
        let _ = Text::with_baseline(text, Point::new(x, y), style, Baseline::Top).draw(self);
    }
}

/// The part of a line that is within a rectangle (Liang and Barsky 1984).
fn clipped(a: [f32; 2], b: [f32; 2], clip: Rect) -> Option<([f32; 2], [f32; 2])> {
    let low = [clip.x as f32, clip.y as f32];
    let high = [(clip.x + clip.width) as f32 - 0.01, (clip.y + clip.height) as f32 - 0.01];
    let (mut from, mut to) = (0f32, 1f32);
    for k in 0..2 {
        let d = b[k] - a[k];
        for (p, q) in [(-d, a[k] - low[k]), (d, high[k] - a[k])] {
            let parallel_outside = p == 0.0 && q < 0.0;
            if parallel_outside || !(p.is_finite() && q.is_finite()) {
                return None;
            }
            if p < 0.0 {
                from = from.max(q / p);
            } else if p > 0.0 {
                to = to.min(q / p);
            }
        }
    }
    let at = |s: f32| [a[0] + (b[0] - a[0]) * s, a[1] + (b[1] - a[1]) * s];
    (from <= to).then(|| (at(from), at(to)))
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(self.width, self.height)
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        for Pixel(Point { x, y }, color) in pixels {
            self.blend(x, y, [color.r(), color.g(), color.b()], 1.0);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_stay_within_their_clip() {
        let mut canvas = Canvas::new(8, 6);
        let clip = Rect { x: 2, y: 1, width: 3, height: 4 };
        canvas.rgba.fill(0);
        for (a, b) in [([-1e6, -9e5], [1e6, 1.1e6]), ([0.0, 2.0], [8.0, 2.0]), ([3.0, -5.0], [3.0, 50.0])] {
            canvas.line(a, b, clip, [255; 3], 1.0);
        }
        canvas.line([f32::NAN, 0.0], [1.0, f32::INFINITY], clip, [255; 3], 1.0);
        let lit = |x: usize, y: usize| canvas.rgba[4 * (8 * y + x)] > 0;
        let outside = (0..48).filter(|i| !clip.contains(((i % 8) as f32, (i / 8) as f32)));
        assert!(outside.into_iter().all(|i| !lit(i % 8, i / 8)));
        assert!((2..5).all(|x| lit(x, 2)) && (1..5).all(|y| lit(3, y)));
    }
}
