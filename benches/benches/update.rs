//! Keeping a tree up to date while its triangles drift: each contestant from pose to pose, on one thread.

mod contest;

use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use pivot_benches::{Contest, LIMIT, Soup, field};

fn update(criterion: &mut Criterion) {
    let pool = contest::one_thread();
    let soup = Soup::new(contest::TRIANGLES);
    let poses: Vec<_> = (0..16).map(|i| soup.positions(0.02 * i as f32)).collect();
    let device = contest::embree();
    let mut group = criterion.benchmark_group("update");
    for entry in field(Contest::Update, device.as_ref()) {
        let mut contestant = entry.make(&soup.triangles(&poses[0])).expect("made");
        pool.install(|| {
            for positions in [&poses[0], &poses[15], &poses[0]] {
                contestant.pose(positions);
                contestant.update().expect("updated");
                if entry.name != LIMIT {
                    contest::check(&*contestant, &entry.name);
                }
            }
        });
        // There and back again, so that no step is larger than the others.
        let walk = (0..30).map(|i| if i < 16 { i } else { 30 - i }).cycle();
        let mut run = |count: u64| {
            let mut spent = Duration::ZERO;
            for i in walk.clone().take(count as usize) {
                contestant.pose(&poses[i]);
                let start = Instant::now();
                contestant.update().expect("updated");
                spent += start.elapsed();
            }
            spent
        };
        group.bench_function(&entry.name, |b| b.iter_custom(|count| pool.install(|| run(count))));
    }
}

criterion_group!(benches, update);
criterion_main!(benches);
