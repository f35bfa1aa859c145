//! The judging of rotations in AVX-512: one pair of nodes in one register.
//!
//! Four unions of four boxes each give all that the six rotations make; sums and products are in the order of
//! `Aabb::half_area`, so the bits are those of the scalar kernel.

use std::arch::x86_64::*;

use super::block::Entry;
use super::kernels::{Accepted, refit_height};
use super::shared::SharedNodes;

pub(super) use super::avx2::{fit_leaves, refit_boxes};

/// See [`scalar::judge`](super::scalar::judge).
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw")]
pub(super) fn judge(nodes: SharedNodes<'_>, list: &[Entry], accepted: &mut Accepted) {
    // With the minima negated a union is one maximum, and extents are sums.
    let minima = _mm512_broadcast_f32x8(_mm256_setr_ps(-0.0, -0.0, -0.0, -0.0, 0.0, 0.0, 0.0, 0.0));
    // From lanes of singles and doubles to the order of `Rotation::ALL`.
    let in_order = _mm512_setr_epi32(4, 0, 12, 8, 9, 1, 9, 1, 4, 0, 12, 8, 9, 1, 9, 1);
    for &entry in list {
        let [link_l, link_r] = refit_height(nodes, entry);
        let negated = |pair: __m512| _mm512_xor_ps(pair, minima);
        let n = negated(nodes.pair_wide(entry.first()));
        let (l, r) = (negated(nodes.child_wide(link_l)), negated(nodes.child_wide(link_r)));
        let single_l = _mm512_max_ps(_mm512_shuffle_f32x4::<0x44>(n, n), r); // L u RL, L u RR
        let single_r = _mm512_max_ps(_mm512_shuffle_f32x4::<0xee>(n, n), l); // R u LL, R u LR
        let straight = _mm512_max_ps(l, r); // LL u RL, LR u RR
        let crossed = _mm512_max_ps(l, _mm512_shuffle_f32x4::<0x4e>(r, r)); // LL u RR, LR u RL

        // Extents of four boxes, a quarter of the register each, and 0; those of an empty box are 0.
        let extents = |a, b| {
            let sides = (_mm512_shuffle_f32x4::<0x88>(a, b), _mm512_shuffle_f32x4::<0xdd>(a, b));
            _mm512_max_ps(_mm512_add_ps(sides.0, sides.1), _mm512_setzero_ps())
        };
        // Their products xy, yz, zx, 0.
        let products = |e| _mm512_mul_ps(e, _mm512_permute_ps::<0b11_00_10_01>(e));
        let (singles, doubles) =
            (products(extents(single_l, single_r)), products(extents(straight, crossed)));
        let now = products(extents(n, n));
        // Half areas in the first lane of each quarter for singles, in the second for doubles.
        let xy_yz = _mm512_unpacklo_ps(singles, doubles);
        let areas = _mm512_add_ps(
            _mm512_add_ps(xy_yz, _mm512_permute_ps::<0b01_00_11_10>(xy_yz)),
            _mm512_unpackhi_ps(singles, doubles),
        );
        // Those of L R L R, a quarter each, in every lane.
        let xy_yz = _mm512_add_ps(_mm512_permute_ps::<0>(now), _mm512_permute_ps::<0b01_01_01_01>(now));
        let now = _mm512_add_ps(xy_yz, _mm512_permute_ps::<0b10_10_10_10>(now));

        // Doubles have sums of two boxes, in both of their quarters.
        let neighbors = |v| _mm512_shuffle_f32x4::<0b10_11_00_01>(v, v);
        let then = _mm512_mask_add_ps(areas, 0x2222, areas, neighbors(areas));
        let swapped = _mm512_shuffle_f32x4::<0b00_00_01_01>(now, now);
        let now = _mm512_mask_add_ps(swapped, 0x2222, now, neighbors(now));
        let changes = _mm512_sub_ps(then, now);
        let gains = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(then, now) & 0x3333;
        let changes = _mm512_castps512_ps256(_mm512_permutexvar_ps(in_order, changes));
        accepted.push_if(entry, bytemuck::cast(changes), gains != 0);
    }
}
