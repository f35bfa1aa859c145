//! Cutting a surface into connected patches, and making each a closed shard of even thickness.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use anim::vertex_normals;
use glam::Vec3;
use indexmap::IndexSet;
use rayon::prelude::*;

use crate::shape::Mesh;

/// Cuts a mesh into about `count` connected patches around random seeds, more of them where
/// `density` is high.
///
/// Each triangle goes to the seed that is nearest along the surface, over edges of random cost,
/// which makes the cracks ragged. Gives the patch of each triangle and the number of patches.
pub(crate) fn patches(
    mesh: &Mesh,
    count: usize,
    density: impl Fn(Vec3) -> f32,
    random: &mut fastrand::Rng,
) -> (Vec<u32>, usize) {
    let across = neighbours_across_edges(mesh);
    let centers: Vec<Vec3> = mesh.corners().map(|t| t.iter().sum::<Vec3>() / 3.0).collect();
    let mut weight_up_to = Vec::with_capacity(centers.len());
    let mut total = 0.0_f64;
    for ([a, b, c], &center) in mesh.corners().zip(&centers) {
        let area = 0.5 * (b - a).cross(c - a).length();
        total += f64::from(area * density(center));
        weight_up_to.push(total);
    }
    let mut patch = vec![u32::MAX; centers.len()];
    let mut patch_count = count as u32;
    let mut queue = BinaryHeap::new();
    for p in 0..patch_count {
        let pick = total * random.f64();
        let seed = weight_up_to.partition_point(|&w| w < pick).min(centers.len().saturating_sub(1));
        // Distances are never negative, so that the order of their bits is theirs.
        queue.push(Reverse((0_u32, seed as u32, p)));
    }
    let crack: Vec<f32> = centers.iter().map(|_| 0.5 + random.f32()).collect();
    let mut triangles = 0..centers.len() as u32;
    loop {
        while let Some(Reverse((distance, t, p))) = queue.pop() {
            if patch[t as usize] != u32::MAX {
                continue;
            }
            patch[t as usize] = p;
            for &next in across[t as usize].iter().filter(|&&n| n != u32::MAX) {
                let step = centers[t as usize].distance(centers[next as usize]) * crack[next as usize];
                queue.push(Reverse(((f32::from_bits(distance) + step).to_bits(), next, p)));
            }
        }
        // Pieces of the surface that hold no seed become patches of their own.
        let Some(unreached) = triangles.find(|&t| patch[t as usize] == u32::MAX) else { break };
        queue.push(Reverse((0, unreached, patch_count)));
        patch_count += 1;
    }
    // Leaves out numbers of patches that got no triangle (two seeds on one).
    let mut used = IndexSet::new();
    let patch = patch.into_iter().map(|p| used.insert_full(p).0 as u32).collect();
    (patch, used.len())
}

/// For each triangle the triangles across its edges (0-1, 1-2, 2-0); `u32::MAX` where there is
/// none.
fn neighbours_across_edges(mesh: &Mesh) -> Vec<[u32; 3]> {
    let mut sides = HashMap::with_capacity(3 * mesh.triangles.len() / 2);
    let mut across = vec![[u32::MAX; 3]; mesh.triangles.len()];
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            if let Some((other, side)) = sides.insert((a.min(b), a.max(b)), (t, k)) {
                across[t][k] = other as u32;
                across[other][side] = t as u32;
            }
        }
    }
    across
}

/// The weld of a vertex that shares its normal with no other.
pub(crate) const ALONE: u32 = u32::MAX;

/// A shard per patch: the patch, its copy further in by the thickness at each vertex, and a rim
/// between them, which has vertices of its own.
///
/// With each shard comes, for each vertex, the place on the surface whose normal it has: equal for
/// vertices of neighbouring shards that were one, so that an unbroken surface looks unbroken.
/// [`ALONE`] on the rim.
///
/// `thickness` is asked with a vertex and its outward normal, once for each vertex.
pub(crate) fn shards(
    mesh: &Mesh,
    patch: &[u32],
    count: usize,
    thickness: impl Fn(Vec3, Vec3) -> f32 + Sync,
) -> Vec<(Mesh, Vec<u32>)> {
    let normals = vertex_normals(&mesh.triangles, &mesh.positions);
    let further_in = |(&p, &n): (&Vec3, &Vec3)| p - n * thickness(p, n);
    let inner: Vec<Vec3> = (&mesh.positions, &normals).into_par_iter().map(further_in).collect();
    let across = neighbours_across_edges(mesh);
    let mut by_patch: Vec<Vec<u32>> = vec![Vec::new(); count];
    for (t, &p) in patch.iter().enumerate() {
        by_patch[p as usize].push(t as u32);
    }
    let shard = |triangles: &Vec<u32>| {
        let mut used = IndexSet::new();
        let mut local = |v: u32| used.insert_full(v).0 as u32;
        let outer: Vec<[u32; 3]> =
            triangles.iter().map(|&t| mesh.triangles[t as usize].map(&mut local)).collect();
        let layer = used.len() as u32;
        let mut shard = Mesh::default();
        shard.positions.extend(used.iter().map(|&v| mesh.positions[v as usize]));
        shard.positions.extend(used.iter().map(|&v| inner[v as usize]));
        shard.triangles.extend(outer.iter().map(|&[a, b, c]| [a + layer, c + layer, b + layer]));
        let mut rim = IndexSet::new();
        for (&t, corner) in triangles.iter().zip(&outer) {
            for k in 0..3 {
                let next = across[t as usize][k];
                if next == u32::MAX || patch[next as usize] != patch[t as usize] {
                    // Pairs of the rim come after both layers.
                    let [a, b] =
                        [corner[k], corner[(k + 1) % 3]].map(|c| 2 * (layer + rim.insert_full(c).0 as u32));
                    shard.triangles.extend([[a, a + 1, b], [b, a + 1, b + 1]]);
                }
            }
        }
        shard.triangles.extend(outer);
        for c in rim {
            shard.positions.extend([c, c + layer].map(|c| shard.positions[c as usize]));
        }
        let mut weld: Vec<u32> = used.iter().map(|v| 2 * v).chain(used.iter().map(|v| 2 * v + 1)).collect();
        weld.resize(shard.positions.len(), ALONE);
        (shard, weld)
    };
    by_patch.iter().map(shard).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::sphere;

    #[test]
    fn patches_are_connected_and_shards_are_closed() {
        let ball = sphere(1.0, 40, 30);
        let mut random = fastrand::Rng::with_seed(4);
        let (patch, count) = patches(&ball, 30, |_| 1.0, &mut random);
        assert_eq!(patch.len(), ball.triangles.len());
        let across = neighbours_across_edges(&ball);
        for p in 0..count as u32 {
            let members: Vec<usize> = (0..patch.len()).filter(|&t| patch[t] == p).collect();
            let mut reached = vec![false; patch.len()];
            let mut queue = vec![members[0]];
            while let Some(t) = queue.pop() {
                if !std::mem::replace(&mut reached[t], true) {
                    queue.extend(across[t].map(|n| n as usize).into_iter().filter(|&n| patch[n] == p));
                }
            }
            assert!(members.iter().all(|&t| reached[t]), "patch {p} is connected");
        }
        let shards = shards(&ball, &patch, count, |_, _| 0.1);
        let volume = |mesh: &Mesh| -> f32 { mesh.corners().map(|[a, b, c]| a.cross(b).dot(c) / 6.0).sum() };
        for (mesh, weld) in &shards {
            // In a closed surface each directed edge has its opposite.
            let place = |v: u32| mesh.positions[v as usize].to_array().map(f32::to_bits);
            let mut edges: Vec<_> = mesh
                .triangles
                .iter()
                .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
                .map(|(a, b)| (place(a), place(b)))
                .collect();
            edges.sort_unstable();
            assert!(edges.iter().all(|&(a, b)| edges.binary_search(&(b, a)).is_ok()));
            assert!(volume(mesh) > 0.0, "the outside is outside");
            assert_eq!(weld.len(), mesh.positions.len());
            for (&p, &w) in mesh.positions.iter().zip(weld).filter(|&(_, &w)| w != ALONE && w % 2 == 0) {
                assert_eq!(p, ball.positions[w as usize / 2], "a vertex is where its weld says");
            }
        }
        let sum: f32 = shards.iter().map(|(mesh, _)| volume(mesh)).sum();
        let wall = 4.0 / 3.0 * std::f32::consts::PI * (1.0 - 0.9_f32.powi(3));
        assert!((sum / wall - 1.0).abs() < 0.02, "shards fill the wall: {sum} of {wall}");
    }
}
