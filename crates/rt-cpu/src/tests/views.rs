//! The eight-wide view: made again and again, of any tree, on any number of threads.

use bvh_core::Visits;

use super::*;

/// All of what rays see.
fn bytes(wide: &Bvh8) -> Vec<u8> {
    [bytemuck::cast_slice(&wide.nodes), bytemuck::cast_slice(&wide.blocks)].concat()
}

/// Views keep nothing of what they were of before.
#[test]
fn views_of_other_trees_and_of_nothing() {
    let (large, small) = (random_soup(300, 0.5), random_soup(3, 2.0));
    let mut wide = Bvh8::default();
    let test = TriangleTest::Watertight;
    let agrees = |wide: &Bvh8, t: &Triangles<'_>| {
        let hits = random_rays(200).into_iter().filter(|ray| {
            let truth = closest_hit_brute(t, ray, f32::INFINITY, test);
            assert_eq!(bits(wide.closest_hit(ray, f32::INFINITY, test)), bits(truth));
            assert_eq!(wide.any_hit(ray, f32::INFINITY, test), truth.is_some());
            truth.is_some()
        });
        hits.count()
    };
    assert_eq!(agrees(&wide, &Soup::default().triangles()), 0);
    for soup in [&large, &small, &large] {
        wide.update(&tree(soup, 2), &soup.triangles());
        assert!(agrees(&wide, &soup.triangles()) > 10);
    }
    // Triangles that are no longer there.
    let fewer = Triangles { indices: &large.indices[..150], ..large.triangles() };
    wide.update(&tree(&large, 2), &fewer);
    assert!(agrees(&wide, &fewer) > 10);
    wide.update(&Bvh::default(), &large.triangles());
    assert_eq!(agrees(&wide, &Soup::default().triangles()), 0);
}

#[test]
fn visits_are_counted_and_change_no_hit() {
    let soup = random_soup(2000, 0.3);
    let mut wide = Bvh8::default();
    wide.update(&tree(&soup, 1), &soup.triangles());
    let (mut closest, mut any, test) = (Visits::default(), Visits::default(), TriangleTest::Watertight);
    for ray in &random_rays(100) {
        let hit = wide.closest_hit(ray, f32::INFINITY, test);
        assert_eq!(wide.hit::<false>(ray, f32::INFINITY, test, &mut closest), hit);
        assert_eq!(wide.hit::<true>(ray, f32::INFINITY, test, &mut any).is_some(), hit.is_some());
    }
    assert_eq!((closest.queries, any.queries), (100, 100));
    assert!(any.nodes > 100 && closest.nodes > any.nodes, "{any:?} {closest:?}");
    assert!(closest.nodes < 100 * wide.nodes.len() as u64 / 4, "{closest:?} of {}", wide.nodes.len());
}

#[test]
fn batches_are_single_rays_in_order_on_any_number_of_threads() {
    let soup = random_soup(200, 0.4);
    let t = soup.triangles();
    let mut wide = Bvh8::default();
    wide.update(&tree(&soup, 3), &t);
    let rays = random_rays(700);
    let t_max: Vec<f32> = (0..700).map(|i| [f32::INFINITY, 0.7, -1.0][i % 3]).collect();
    let mut hits = vec![None; 700];
    for test in TriangleTest::ALL {
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| wide.closest_hits(&rays, &t_max, test, &mut hits));
            for i in 0..700 {
                assert_eq!(bits(hits[i]), bits(closest_hit_brute(&t, &rays[i], t_max[i], test)));
            }
            assert!(hits.iter().flatten().count() > 50);
            hits.fill(None);
        }
    }
}

#[test]
#[should_panic = "one t_max a ray"]
fn a_batch_has_one_t_max_a_ray() {
    Bvh8::default().closest_hits(&random_rays(3), &[1.0; 4], TriangleTest::Watertight, &mut [None; 3]);
}

#[test]
#[should_panic = "one hit a ray"]
fn a_batch_has_one_hit_a_ray() {
    Bvh8::default().closest_hits(&random_rays(3), &[1.0; 3], TriangleTest::Watertight, &mut [None; 2]);
}

/// Large enough to be shared out, with leaves that fit into blocks and leaves that do not.
#[test]
fn views_are_the_same_for_any_number_of_threads() {
    let soup = random_soup(20_000, 0.02);
    let t = soup.triangles();
    for leaf in [1, 3, 700] {
        let bvh = tree(&soup, leaf);
        let views = [1, 2, 5].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let mut wide = Bvh8::default();
            pool.install(|| wide.update(&bvh, &t));
            bytes(&wide)
        });
        assert!(views[0] == views[1] && views[0] == views[2], "leaves of {leaf}");
    }
}

/// An update leaves nothing of the view before, wherever it was in memory.
#[test]
fn views_made_again_are_as_if_made_first() {
    let (large, small) = (random_soup(3000, 0.1), random_soup(700, 0.3));
    let mut again = Bvh8::default();
    for (soup, leaf) in [(&large, 1), (&small, 2), (&large, 40), (&small, 1), (&large, 1)] {
        let (bvh, mut first) = (tree(soup, leaf), Bvh8::default());
        again.update(&bvh, &soup.triangles());
        first.update(&bvh, &soup.triangles());
        assert_eq!(bytes(&again), bytes(&first));
    }
}
