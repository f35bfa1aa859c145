//! Tears a sphere to pieces and updates three trees in every frame: one is refitted, one is
//! refitted and rotated, one is rebuilt. Prints the SAH cost of each: the expected work of a ray.

use std::error::Error;
use std::time::Instant;

use pivot_bvh::{Builder, Rotate, Strategy, Triangles, Updater, Vec3, build, sah_cost};
use pivot_examples::sphere;

fn main() -> Result<(), Box<dyn Error>> {
    let (rest, shared) = sphere(150);
    // Every triangle gets corners of its own, so that it can fly where it likes.
    let mut corners: Vec<Vec3> = shared.iter().flatten().map(|&v| rest[v as usize]).collect();
    let mut indices: Vec<[u32; 3]> =
        (0..shared.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();

    let triangles = Triangles { positions: &corners, indices: &indices };
    let mut refitted = build(&triangles, Builder::Sweep)?;
    // In the order of the leaves, updates read triangles one after the other. `order` has the old
    // numbers.
    let order = refitted.reorder_primitives();
    indices = order.iter().map(|&old| indices[old as usize]).collect();
    let mut rotated = refitted.clone();
    let mut refits = Updater::new(Strategy::Refit);
    let mut rotates = Updater::new(Strategy::RefitRotate(Rotate::default()));

    println!("{} triangles\nframe   refit        refit+rotate            rebuild", indices.len());
    for frame in 1..=20 {
        for (i, triangle) in corners.chunks_exact_mut(3).enumerate() {
            // Speeds in no order; an example does without a crate for random numbers.
            let speed = 0.02 + 0.06 * ((i * 7919) % 1000) as f32 / 1000.0;
            let step = triangle[0].normalize_or_zero() * speed + Vec3::new(0.0, -0.002 * frame as f32, 0.0);
            triangle.iter_mut().for_each(|corner| *corner += step);
        }
        let triangles = Triangles { positions: &corners, indices: &indices };

        let timer = Instant::now();
        let refit = refits.update(&mut refitted, &triangles)?;
        let refit_ms = timer.elapsed().as_secs_f64() * 1e3;
        let timer = Instant::now();
        let rotate = rotates.update(&mut rotated, &triangles)?;
        let rotate_ms = timer.elapsed().as_secs_f64() * 1e3;
        let timer = Instant::now();
        let fresh = build(&triangles, Builder::Binned)?;
        let fresh_ms = timer.elapsed().as_secs_f64() * 1e3;

        println!(
            "{frame:5} {:7.1} {refit_ms:4.1} ms {:7.1} {rotate_ms:4.1} ms {:5} rot. {:7.1} {fresh_ms:4.1} ms",
            refit.sah_cost.unwrap_or_else(|| sah_cost(&refitted)),
            rotate.sah_cost.unwrap_or_else(|| sah_cost(&rotated)),
            rotate.rotations_applied(),
            sah_cost(&fresh),
        );
    }
    Ok(())
}
