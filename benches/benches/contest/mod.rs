//! What the three benches share: their scene's size, Embree where it is, and the check before anything is timed.

use pivot_benches::embree::{Device, Embree};
use pivot_benches::{Answers, Brute, Contestant, Soup};
use rayon::{ThreadPool, ThreadPoolBuilder};
use rt_cpu::Pixel;

/// Triangles of the scene.
pub(crate) const TRIANGLES: usize = 20_000;

/// A pool of one thread.
pub(crate) fn one_thread() -> ThreadPool {
    ThreadPoolBuilder::new().num_threads(1).build().expect("a thread")
}

/// Embree on one thread, where it is found.
pub(crate) fn embree() -> Option<Device> {
    match Embree::load(None).and_then(|embree| embree.device(1)) {
        Ok(device) => Some(device),
        Err(reason) => {
            eprintln!("{reason}");
            None
        }
    }
}

/// Stops everything if a contestant finds something else than brute force does.
pub(crate) fn check(contestant: &dyn Contestant, name: &str) {
    const SIZE: u32 = 32;
    let cast = |contestant: &dyn Contestant| {
        let mut pixels = vec![Pixel::default(); (SIZE * SIZE) as usize];
        contestant.cast(&Soup::view(SIZE), &mut pixels);
        pixels
    };
    let expected = cast(&Brute::new(&contestant.triangles()));
    let (mut answers, mut reference) = (Answers::default(), Answers::default());
    answers.add(&cast(contestant), &expected);
    reference.add(&expected, &expected);
    assert!(answers.agrees_with(&reference), "{name} finds {answers:?}, brute force {reference:?}");
}
