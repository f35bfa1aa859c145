//! Building a tree from nothing, on one thread.

mod contest;

use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use pivot_benches::{Contest, Soup, field};

fn build(criterion: &mut Criterion) {
    let pool = contest::one_thread();
    let soup = Soup::new(contest::TRIANGLES);
    let positions = soup.positions(0.0);
    let device = contest::embree();
    let mut group = criterion.benchmark_group("build");
    for entry in field(Contest::Build, device.as_ref()) {
        let build = || {
            let mut contestant = entry.make(&soup.triangles(&positions)).expect("made");
            let start = Instant::now();
            contestant.update().expect("built");
            (start.elapsed(), contestant)
        };
        pool.install(|| contest::check(&*build().1, &entry.name));
        let run = |count: u64| (0..count).map(|_| build().0).sum::<Duration>();
        group.bench_function(&entry.name, |b| b.iter_custom(|count| pool.install(|| run(count))));
    }
}

criterion_group!(benches, build);
criterion_main!(benches);
