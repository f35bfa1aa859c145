//! The window: passes events to the state and shows its pictures.

use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow};
use softbuffer::Surface;
use viewer_core::{Button, Event, Key, Request, Settings, State};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, MouseButton, MouseScrollDelta, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::keyboard::{Key as WinitKey, NamedKey};
use winit::window::{Window, WindowId};

use crate::film::{Film, save};
use crate::timing::Timing;
use crate::{Args, CLOCK, load};

/// Pixels of a touchpad's scrolling that count as a notch of a wheel.
const NOTCH: f32 = 40.0;

/// Shows the window until it is closed.
pub(crate) fn run(args: &Args, settings: Settings) -> Result<()> {
    // Its error names a line of a library, which helps nobody.
    let event_loop = EventLoop::<Event>::with_user_event().build().ok().context(
        "no display for a window (on Linux an X server, named by DISPLAY); --out FILE draws without one",
    )?;
    let mut state = State::new(args.size.0, args.size.1, load::names(&args.scene), CLOCK);
    state.apply(Event::Settings(settings));
    state.step_beside();
    let threads = args.threads.unwrap_or(0) as usize;
    let steps =
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().context("threads cannot be started")?;
    let proxy = event_loop.create_proxy();
    let mut app = App {
        args,
        state,
        proxy,
        steps,
        surface: None,
        last: Instant::now(),
        rests: true,
        film: None,
        failed: None,
        timing: args.timing.map(|seconds| Timing::new(seconds, args.size)),
    };
    event_loop.run_app(&mut app).context("the window's events ended")?;
    app.timing.into_iter().for_each(Timing::print);
    app.failed.map_or(Ok(()), Err)
}

struct App<'a> {
    args: &'a Args,
    state: State,
    proxy: EventLoopProxy<Event>,
    /// Threads for steps, beside those that draw.
    steps: rayon::ThreadPool,
    surface: Option<Surface<Arc<Window>, Arc<Window>>>,
    /// When the last picture was drawn, or the first event came after a rest.
    last: Instant,
    /// Whether the last picture stays.
    rests: bool,
    /// What is being recorded.
    film: Option<Film>,
    failed: Option<anyhow::Error>,
    timing: Option<Timing>,
}

impl App<'_> {
    fn open(&mut self, event_loop: &ActiveEventLoop) -> Result<()> {
        let size = PhysicalSize::new(self.args.size.0, self.args.size.1);
        let attributes = Window::default_attributes().with_title("Pivot").with_inner_size(size);
        let window = Arc::new(event_loop.create_window(attributes).context("no window")?);
        let context =
            softbuffer::Context::new(Arc::clone(&window)).map_err(|e| anyhow!("no picture: {e}"))?;
        self.surface =
            Some(Surface::new(&context, Arc::clone(&window)).map_err(|e| anyhow!("no picture: {e}"))?);
        let PhysicalSize { width, height } = window.inner_size();
        self.state.apply(Event::Resize(width, height));
        window.request_redraw();
        Ok(())
    }

    fn draw(&mut self) -> Result<()> {
        if self.surface.is_none() {
            return Ok(());
        }
        let seconds = std::mem::replace(&mut self.last, Instant::now()).elapsed().as_secs_f64();
        self.state.apply(Event::Tick(seconds));
        // The next step, beside the picture of this one.
        self.begin_step();
        let canvas = self.state.draw();
        let (Some(width), Some(height)) = (NonZeroU32::new(canvas.width), NonZeroU32::new(canvas.height))
        else {
            return Ok(());
        };
        if let Some(film) = &mut self.film {
            film.push(canvas)?;
        }
        let Some(surface) = &mut self.surface else { return Ok(()) };
        let error = |e| anyhow!("no picture: {e}");
        surface.resize(width, height).map_err(error)?;
        let mut buffer = surface.buffer_mut().map_err(error)?;
        for (to, pixel) in buffer.iter_mut().zip(canvas.rgba.chunks_exact(4)) {
            *to = u32::from_be_bytes([0, pixel[0], pixel[1], pixel[2]]);
        }
        buffer.present().map_err(error)?;
        self.rests = self.state.is_at_rest();
        if let Some(timing) = &mut self.timing {
            timing.shown(&mut self.state, seconds);
        }
        Ok(())
    }

    /// Counts time from now on: what stood still did not take long.
    fn wake(&mut self) {
        if std::mem::take(&mut self.rests) {
            self.last = Instant::now();
        }
    }

    fn redraw(&self) {
        if let Some(surface) = &self.surface {
            surface.window().request_redraw();
        }
    }

    /// Begins a step on the threads for steps, if one is to be made.
    fn begin_step(&mut self) {
        if let Some(step) = self.state.take_step() {
            let proxy = self.proxy.clone();
            // Nobody listens once the window is closed.
            self.steps.spawn(move || drop(proxy.send_event(Event::Stepped(Box::new(step.run())))));
        }
    }

    /// Does what the state asks for. What fails is said in the window.
    fn serve(&mut self, event_loop: &ActiveEventLoop) {
        self.begin_step();
        for request in self.state.take_requests() {
            let done = match request {
                Request::Load(name) => {
                    let proxy = self.proxy.clone();
                    let clip = self.args.clip.clone().filter(|_| name == self.args.scene);
                    load::begin(name, clip, move |event| proxy.send_event(event).is_ok());
                    continue;
                }
                Request::Quit => {
                    event_loop.exit();
                    continue;
                }
                Request::Save => self.save(&self.args.folder),
                Request::Record(true) => Film::folder(&unused(&self.args.folder, "film", "")).map(|film| {
                    self.film = Some(film);
                    "recording".to_owned()
                }),
                Request::Record(false) => self.film.take().map_or(Ok(String::new()), Film::finish_line),
            };
            let message = done.unwrap_or_else(|error| format!("{error:#}"));
            println!("{}", anim::printable(&message));
            self.state.apply(Event::Message(message));
        }
    }

    fn save(&mut self, folder: &Path) -> Result<String> {
        Film::folder(folder)?;
        let path = unused(folder, "picture", ".png");
        save(self.state.draw(), &path)?;
        Ok(format!("saved {}", path.display()))
    }
}

/// The first path of a name and a number that does not exist in a folder: nothing is written over.
fn unused(folder: &Path, name: &str, extension: &str) -> PathBuf {
    let path = |number: usize| folder.join(format!("{name}-{number:04}{extension}"));
    (0..).map(path).find(|path| !path.exists()).unwrap_or_else(|| path(0))
}

impl Film {
    fn finish_line(self) -> Result<String> {
        Ok(format!("recorded {}", self.finish()?.display()))
    }
}

/// The key of the state for a key of the window.
fn key(key: &WinitKey) -> Option<Key> {
    match key {
        WinitKey::Character(text) => text.chars().next().map(Key::Char),
        WinitKey::Named(NamedKey::Space) => Some(Key::Char(' ')),
        WinitKey::Named(NamedKey::ArrowLeft) => Some(Key::Left),
        WinitKey::Named(NamedKey::ArrowRight) => Some(Key::Right),
        WinitKey::Named(NamedKey::Home) => Some(Key::Home),
        WinitKey::Named(NamedKey::Escape) => Some(Key::Escape),
        _ => None,
    }
}

impl ApplicationHandler<Event> for App<'_> {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.surface.is_none()
            && let Err(error) = self.open(event_loop)
        {
            self.failed = Some(error);
            event_loop.exit();
        }
        self.serve(event_loop);
    }

    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        if matches!(cause, StartCause::ResumeTimeReached { .. }) {
            self.redraw();
        }
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, event: Event) {
        self.wake();
        self.state.apply(event);
        self.serve(event_loop);
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        self.wake();
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::Resized(size) => self.state.apply(Event::Resize(size.width, size.height)),
            WindowEvent::KeyboardInput { event, .. } => {
                let down = event.state == ElementState::Pressed;
                if let Some(key) = key(&event.logical_key).filter(|_| !(event.repeat && down)) {
                    self.state.apply(Event::Key(key, down));
                }
            }
            WindowEvent::CursorMoved { position, .. } => {
                self.state.apply(Event::Pointer(position.x as f32, position.y as f32));
            }
            WindowEvent::MouseInput { state, button, .. } => {
                let button = if button == MouseButton::Left { Button::Left } else { Button::Right };
                self.state.apply(Event::Button(button, state == ElementState::Pressed));
            }
            WindowEvent::MouseWheel { delta, .. } => {
                let notches = match delta {
                    MouseScrollDelta::LineDelta(_, y) => y,
                    MouseScrollDelta::PixelDelta(pixels) => pixels.y as f32 / NOTCH,
                };
                self.state.apply(Event::Wheel(notches));
            }
            WindowEvent::RedrawRequested => {
                if let Err(error) = self.draw() {
                    self.failed = Some(error);
                    event_loop.exit();
                }
            }
            _ => {}
        }
        self.serve(event_loop);
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let idle = self.state.idle_seconds();
        event_loop.set_control_flow(if idle > 0.0 && idle.is_finite() {
            ControlFlow::WaitUntil(Instant::now() + Duration::from_secs_f64(idle))
        } else {
            ControlFlow::Wait
        });
        if idle == 0.0 && !self.state.is_at_rest() {
            self.redraw();
        }
    }
}
