//! What can be set: one table for the panel, the mouse and the keys.

use std::path::Path;

use bvh_update::Strategy;
use rt_cpu::{StageTimes, TriangleTest};
use scenes::LightEffects;

use crate::draw::Probe;
use crate::events::Request;
use crate::side::{Side, strategies};
use crate::state::State;

/// Deepest boxes that can be drawn.
const DEEPEST: u32 = 12;
/// Frames of the animation in a 24th of a second.
const SPEEDS: [f64; 6] = [0.125, 0.25, 0.5, 1.0, 2.0, 4.0];
const PERIODS: [u32; 5] = [1, 2, 4, 8, 16];
const SAMPLES: [u32; 5] = [1, 4, 16, 64, 256];

/// All that is set by hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The strategy of the tree on the left, or of the only one.
    pub left: Strategy,
    /// The strategy of the tree on the right, if there is one.
    pub right: Option<Strategy>,
    /// Whether the nodes that rays visit are shown in place of the scene.
    pub heat: bool,
    /// The depth of the boxes that are drawn, if any are.
    pub boxes: Option<u32>,
    /// Whether nodes flash that rotated.
    pub flash: bool,
    /// How rays are tested against triangles.
    pub test: TriangleTest,
    /// The period of rotations: each node has its turn once in this number of updates.
    pub period: u32,
    /// Samples of each pixel once the picture stands still. `None`: as many as the effects call
    /// for.
    pub samples: Option<u32>,
    /// Frames of the animation in a 24th of a second.
    pub speed: f64,
    /// What light does. `None`: what the scene calls for.
    pub light: Option<LightEffects>,
    /// How much is drawn over the picture: 0 nothing, 1 titles and graphs, 2 the panel as well.
    pub overlay: u32,
}

impl Default for Settings {
    fn default() -> Self {
        let named = |name: &str| name.parse().unwrap_or_default();
        Self {
            left: named("refit"),
            right: Some(named("refit+rotate")),
            heat: false,
            boxes: None,
            flash: false,
            test: TriangleTest::default(),
            period: 1,
            samples: None,
            speed: 1.0,
            light: None,
            overlay: 2,
        }
    }
}

/// The controls that are sliders: what accuracy costs.
pub(crate) const SLIDERS: [Control; 3] = [Control::Test, Control::Budget, Control::Samples];

/// Something that a key or a click changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Control {
    Scene,
    Play,
    Speed,
    Left,
    Right,
    Heat,
    Boxes,
    Flash,
    Test,
    Budget,
    Samples,
    Effect(LightEffects),
    Fresh,
    Eye,
    Overlay,
    Save,
    Record,
}

/// Every control with its key and its label. A letter with the shift key, and the right button, go
/// the other way.
pub(crate) const CONTROLS: [(char, &str, Control); 22] = [
    ('n', "scene", Control::Scene),
    (' ', "play", Control::Play),
    ('v', "speed", Control::Speed),
    ('1', "left", Control::Left),
    ('2', "right", Control::Right),
    ('h', "heat", Control::Heat),
    ('b', "boxes", Control::Boxes),
    ('f', "flash rotated", Control::Flash),
    ('t', "triangle test", Control::Test),
    ('r', "rotation budget", Control::Budget),
    ('m', "samples", Control::Samples),
    ('l', "shadows", Control::Effect(LightEffects::SHADOWS)),
    ('x', "textures", Control::Effect(LightEffects::TEXTURES)),
    ('k', "cutouts", Control::Effect(LightEffects::ALPHA)),
    ('i', "mirrors", Control::Effect(LightEffects::MIRROR)),
    ('o', "occlusion", Control::Effect(LightEffects::AMBIENT_OCCLUSION)),
    ('g', "bounces", Control::Effect(LightEffects::DIFFUSE_BOUNCES)),
    ('z', "fresh trees", Control::Fresh),
    ('c', "scene's camera", Control::Eye),
    ('u', "overlay", Control::Overlay),
    ('p', "save picture", Control::Save),
    ('y', "record", Control::Record),
];

/// The time that an effect of the light took, in milliseconds.
fn milliseconds(effect: LightEffects, times: &StageTimes) -> f64 {
    let time = match effect {
        LightEffects::SHADOWS => times.shadow,
        LightEffects::TEXTURES => times.textures,
        LightEffects::ALPHA => times.alpha,
        LightEffects::MIRROR => times.mirror,
        LightEffects::AMBIENT_OCCLUSION => times.ambient_occlusion,
        _ => times.diffuse_bounces,
    };
    1e3 * time.as_secs_f64()
}

/// The place of a value in a row of them.
fn place<T: PartialEq>(values: &[T], now: T) -> usize {
    values.iter().position(|value| *value == now).unwrap_or(0)
}

/// The next of some values after the present one, or the one before.
fn next<T: Copy + PartialEq>(values: &[T], now: T, back: bool) -> T {
    let at = place(values, now);
    let by = if back { values.len() - 1 } else { 1 };
    values.get((at + by) % values.len().max(1)).copied().unwrap_or(now)
}

impl State {
    /// What a control is set to, for the panel.
    pub(crate) fn value(&self, control: Control) -> String {
        let set = &self.settings;
        let on = |on: bool| if on { "on" } else { "off" }.to_owned();
        match control {
            // Of a file its name, as a path is too long for the panel.
            Control::Scene => {
                let name = Path::new(self.scene_name()).file_name();
                name.map_or_else(|| self.scene_name().into(), |name| name.to_string_lossy()).into_owned()
            }
            Control::Play => on(self.playing),
            Control::Speed => format!("x {}", set.speed),
            Control::Left => set.left.name().to_owned(),
            Control::Right => set.right.map_or("none", |strategy| strategy.name()).to_owned(),
            Control::Heat => on(set.heat),
            Control::Boxes => set.boxes.map_or("off".to_owned(), |depth| format!("depth {depth}")),
            Control::Flash => on(set.flash),
            Control::Test => set.test.name().to_owned(),
            Control::Budget if set.period == 1 => "all".to_owned(),
            Control::Budget => format!("1 in {}", set.period),
            Control::Samples => format!("{} of {}", self.samples_done(), self.samples()),
            Control::Effect(effect) => {
                let is_on = self.light_effects().contains(effect);
                let ms = milliseconds(effect, &self.stage_times());
                if is_on && ms > 0.0 { format!("on {ms:.1} ms") } else { on(is_on) }
            }
            Control::Record => on(self.recording),
            Control::Fresh | Control::Eye | Control::Save | Control::Overlay => String::new(),
        }
    }

    /// Where a slider stands, and how many places it has; the last one is the most accurate.
    pub(crate) fn slider(&self, control: Control) -> Option<(usize, usize)> {
        let set = &self.settings;
        match control {
            Control::Test => Some((place(&TriangleTest::ALL, set.test), TriangleTest::ALL.len())),
            Control::Budget => Some((PERIODS.len() - 1 - place(&PERIODS, set.period), PERIODS.len())),
            Control::Samples => Some((place(&SAMPLES, self.samples()), SAMPLES.len())),
            _ => None,
        }
    }

    /// Moves a slider to a place.
    pub(crate) fn slide(&mut self, control: Control, to: usize) {
        let Some((now, count)) = self.slider(control) else { return };
        let to = to.min(count - 1);
        match control {
            _ if to == now => return,
            Control::Test => self.settings.test = TriangleTest::ALL[to],
            Control::Budget => self.settings.period = PERIODS[count - 1 - to],
            _ => self.settings.samples = Some(SAMPLES[to]),
        }
        self.settings_changed();
    }

    /// What the setting of a slider costs in time, and its error, in words.
    pub(crate) fn price(&self, control: Control) -> String {
        let Some(shown) = &self.shown else { return String::new() };
        match control {
            Control::Test => self.probe.map_or(
                "compared with f64 at a stop".to_owned(),
                |Probe { ns, exact_ns, differ, pixels, .. }| {
                    format!("{ns:.0} ns/ray (f64 {exact_ns:.0}), {differ}/{pixels} off")
                },
            ),
            Control::Budget => {
                let rotates = |side: &&Side| side.last.rotations_applied() > 0;
                let found = self.sides().rfind(rotates).or(self.sides().next_back());
                let Some(side) = found else { return String::new() };
                let sample = side.sample(shown.frame);
                let fresh = shown.fresh_cost(shown.frame).filter(|&fresh| fresh > 0.0);
                let over = fresh.map(|fresh| format!(", cost {:.2} x fresh", f64::from(sample.cost) / fresh));
                format!("update {:.1} ms{}", sample.update_ms, over.unwrap_or_default())
            }
            _ => {
                let ms: f64 = self.sides().map(|side| side.trace_ms).sum();
                let noise = self.sides().filter_map(|side| side.noise).max_by(f64::total_cmp);
                let error =
                    noise.map_or("noise not known".to_owned(), |n| format!("noise {:.2} %", 100.0 * n));
                format!("{:.0} ms, {error}", ms * f64::from(self.samples()))
            }
        }
    }

    /// Changes what a control is set to, forwards or back.
    pub(crate) fn step(&mut self, control: Control, back: bool) {
        let (all, samples) = (strategies(), self.samples());
        let set = &mut self.settings;
        match control {
            Control::Scene => self.next_scene(back),
            Control::Play => self.playing = !self.playing,
            Control::Speed => set.speed = next(&SPEEDS, set.speed, back),
            Control::Left => set.left = next(&all, set.left, back),
            Control::Right => {
                let all: Vec<_> = std::iter::once(None).chain(all.into_iter().map(Some)).collect();
                set.right = next(&all, set.right, back);
            }
            Control::Heat => set.heat = !set.heat,
            Control::Boxes => {
                let all: Vec<_> = std::iter::once(None).chain((0..=DEEPEST).map(Some)).collect();
                set.boxes = next(&all, set.boxes, back);
            }
            Control::Flash => set.flash = !set.flash,
            Control::Test => set.test = next(&TriangleTest::ALL, set.test, back),
            Control::Budget => set.period = next(&PERIODS, set.period, back),
            Control::Samples => set.samples = Some(next(&SAMPLES, samples, back)),
            Control::Effect(effect) => {
                let light = self.light_effects() ^ effect;
                (self.settings.light, self.settings.samples) = (Some(light), None);
            }
            Control::Fresh => self.restart_trees(),
            Control::Eye => self.eye.reset(),
            Control::Overlay => set.overlay = next(&[0, 1, 2], set.overlay, !back),
            Control::Save => self.requests.push(Request::Save),
            Control::Record => {
                self.recording = !self.recording;
                self.requests.push(Request::Record(self.recording));
            }
        }
        self.settings_changed();
    }
}
