//! Steps that another thread makes, while what is shown can be drawn and changed.

mod common;

use common::{at_rest, press, rendered, toys, viewer};
use viewer_core::{Event, Key, Ready, Settings, State, Step};

/// A viewer of the toys whose steps are taken by hand.
fn beside() -> State {
    let mut state = viewer();
    state.step_beside();
    at_rest(&mut state);
    state
}

fn frame(state: &State) -> usize {
    state.frame().expect("a scene").0
}

fn taken(state: &mut State) -> Step {
    let step = state.take_step().expect("a step");
    assert!(state.take_step().is_none(), "one at a time");
    assert!(!state.is_at_rest());
    step
}

fn finish(state: &mut State, step: Step) {
    state.apply(Event::Stepped(Box::new(step.run())));
}

/// Makes all steps that are left.
fn catch_up(state: &mut State) {
    while let Some(step) = state.take_step() {
        finish(state, step);
    }
}

#[test]
fn the_frame_before_is_drawn_from_anywhere_until_the_step_is_made() {
    let mut state = beside();
    for next in 1..4 {
        state.apply(Event::Key(Key::Right, true));
        let step = taken(&mut state);
        assert!(state.draw().rgba == rendered(next - 1), "as before");
        state.apply(Event::Wheel(1.0));
        assert!(state.draw().rgba != rendered(next - 1), "from elsewhere");
        press(&mut state, 'c');
        state.draw();
        assert_eq!((frame(&state), state.idle_seconds()), (next - 1, f64::INFINITY), "nothing to draw");
        finish(&mut state, step);
        assert_eq!((frame(&state), state.idle_seconds()), (next, 0.0));
        assert!(at_rest(&mut state).rgba == rendered(next));
    }
}

#[test]
fn of_several_frames_that_are_asked_for_meanwhile_the_last_counts() {
    let mut state = beside();
    state.apply(Event::Key(Key::Right, true));
    let step = taken(&mut state);
    (0..3).for_each(|_| state.apply(Event::Key(Key::Right, true)));
    finish(&mut state, step);
    assert_eq!(frame(&state), 1);
    let step = taken(&mut state);
    finish(&mut state, step);
    assert_eq!(frame(&state), 4);
    assert!(at_rest(&mut state).rgba == rendered(4));
}

#[test]
fn while_it_plays_each_frame_is_shown_although_steps_are_late() {
    let mut state = beside();
    press(&mut state, ' ');
    let mut seen = Vec::new();
    for _ in 0..5 {
        state.apply(Event::Tick(1.0));
        let step = taken(&mut state);
        state.apply(Event::Tick(1.0));
        state.draw();
        finish(&mut state, step);
        seen.push(frame(&state));
    }
    assert_eq!(seen, [1, 2, 3, 4, 5]);
}

#[test]
fn trees_that_come_and_go_meanwhile_are_brought_to_the_frame() {
    let mut state = beside();
    let set = |state: &mut State, right: Option<&str>| {
        let right = right.map(|name| name.parse().expect("a strategy"));
        state.apply(Event::Settings(Settings { right, ..state.settings() }));
    };
    state.apply(Event::Key(Key::Right, true));
    let step = taken(&mut state);
    set(&mut state, Some("refit+rotate"));
    set(&mut state, None);
    set(&mut state, Some("lbvh"));
    finish(&mut state, step);
    state.draw();
    assert!(!state.is_at_rest(), "the right tree is at the first frame");
    let step = taken(&mut state);
    set(&mut state, None);
    finish(&mut state, step);
    assert!(at_rest(&mut state).rgba == rendered(1));
    set(&mut state, Some("lbvh"));
    catch_up(&mut state);
    let both = at_rest(&mut state);
    state.apply(Event::Key(Key::Right, true));
    catch_up(&mut state);
    assert!(at_rest(&mut state) != both);
}

#[test]
fn fresh_trees_and_scenes_that_come_meanwhile_make_its_step_void() {
    let mut state = beside();
    state.apply(Event::Key(Key::Right, true));
    let step = taken(&mut state);
    state.apply(Event::Key(Key::Home, true));
    finish(&mut state, step);
    catch_up(&mut state);
    assert!(frame(&state) == 0 && at_rest(&mut state).rgba == rendered(0));

    state.apply(Event::Key(Key::Right, true));
    let step = taken(&mut state);
    state.apply(Event::Scene(Box::new(Ready::new(toys()).expect("few triangles"))));
    assert!(state.take_step().is_none());
    finish(&mut state, step);
    assert!(frame(&state) == 0 && at_rest(&mut state).rgba == rendered(0));
}
