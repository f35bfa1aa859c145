//! Surfaces with holes: rays go on where a hit is not there ([`Material::cutoff`](crate::Material)).
//!
//! Trees and packets know nothing of holes. Rays are first traced as if there were none, which gives the same result
//! unless what they hit is a hole; only those are traced again, one by one, past all holes.

use fearless_simd::Simd;

use crate::Mesh;
use crate::bundle::{Bundle, Hits};
use crate::scene::{Query, Scene, Work};
use bvh_core::pick;
use bvh_core::triangle::Test;

/// Replaces hits of holes by what is behind them; gives the number of rays traced again. For [`Query::Any`] hits in
/// surfaces that have holes anywhere count.
#[inline(never)]
pub(crate) fn see_through<S: Simd, T: Test>(
    simd: S,
    scene: Scene<'_>,
    mesh: &Mesh<'_>,
    query: Query,
    rays: &Bundle,
    hits: &mut Hits,
    work: &mut Work,
) -> u64 {
    simd.vectorize(
        #[inline(always)]
        || {
            let mut again = 0;
            for i in 0..rays.count {
                let Some(hit) = hits.get(i) else { continue };
                let stays = match query {
                    Query::Closest => mesh.is_there(&hit),
                    // Such a hit comes without the place.
                    Query::Any => mesh.material(hit.primitive).cutoff.is_none(),
                };
                if !stays {
                    let ray = rays.ray(i);
                    let hit = match query {
                        Query::Closest => pick::closest::<S, T>(
                            simd,
                            scene.bvh,
                            scene.triangles,
                            &ray,
                            rays.t_max,
                            work,
                            #[inline(always)]
                            |hit| mesh.is_there(hit),
                        ),
                        Query::Any => pick::any::<S, T>(
                            simd,
                            scene.bvh,
                            scene.triangles,
                            &ray,
                            rays.t_max,
                            work,
                            #[inline(always)]
                            |hit| mesh.is_there(hit),
                        ),
                    };
                    hits.set(i, hit);
                    again += 1;
                }
            }
            again
        },
    )
}
