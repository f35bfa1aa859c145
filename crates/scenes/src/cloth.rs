//! A square cloth by extended position-based dynamics with small steps, one iteration each (Macklin
//! et al. 2019, "Small Steps in Physics Simulation"), in stages: gravity, motion, constraints,
//! contact with itself and with whatever the scene is made of.
//!
//! The state is `f64`: in `f32`, rounding takes away what gravity adds in a step of 0.1 ms.
//!
//! All parallel work is over fixed strips of rows or over single particles that read a snapshot, so
//! that the result does not depend on the number of threads.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::near::neighbours;

/// Compliances of the fabric, in length over force, for particles of mass 1.
const STRETCH: f64 = 0.0;
const SHEAR: f64 = 4e-6;
const BEND: f64 = 2e-5;
/// Fraction of the velocity lost per second.
const DRAG: f64 = 0.3;
const GRAVITY: f64 = 60.0;
/// Speed that particles are slowed to; the less it is the less often folds are searched for.
const TOP_SPEED: f64 = 22.0;

/// Particles in a square grid, row after row.
pub(crate) struct Cloth {
    pub(crate) side: usize,
    pub(crate) spacing: f64,
    pub(crate) positions: Vec<DVec3>,
    /// Seconds of a step.
    pub(crate) dt: f64,
    /// Distance that folds keep from one another; below the rest spacing.
    thickness: f64,
    /// Speed that particles are slowed to, so that in one step none crosses a fold.
    top_speed: f64,
    before: Vec<DVec3>,
    velocities: Vec<DVec3>,
    /// For each particle, those of other folds that may touch it until the next search.
    neighbours: Vec<Vec<u32>>,
}

impl Cloth {
    /// A cloth at rest, flat or nearly so, for steps of `dt` seconds. `positions` are
    /// `side * side`, `spacing` apart where flat.
    pub(crate) fn new(side: usize, spacing: f64, positions: Vec<DVec3>, dt: f64) -> Self {
        let thickness = 0.8 * spacing;
        Self {
            side,
            spacing,
            dt,
            top_speed: TOP_SPEED.min(0.2 * thickness / dt),
            before: positions.clone(),
            velocities: vec![DVec3::ZERO; positions.len()],
            neighbours: Vec::new(),
            positions,
            thickness,
        }
    }

    /// Searches for folds that come close, in the first step after a key frame and each time that
    /// others may have come: until the next search none comes from beyond its reach, unless two
    /// meet head on at full speed.
    pub(crate) fn find_folds(&mut self, since_key: usize) {
        let (side, thickness) = (self.side, self.thickness);
        let period = (0.8 * thickness / (self.top_speed * self.dt)).round() as usize;
        if !since_key.is_multiple_of(period) {
            return;
        }
        let points: Vec<Vec3> = self.positions.iter().map(|p| p.as_vec3()).collect();
        // Particles within two grid steps are held apart by the constraints already.
        self.neighbours = neighbours(&points, 1.8 * thickness as f32, |i, j| {
            (i / side).abs_diff(j / side) > 2 || (i % side).abs_diff(j % side) > 2
        });
    }

    /// Accelerates all particles by gravity.
    pub(crate) fn fall(&mut self) -> usize {
        let pull = DVec3::NEG_Y * (GRAVITY * self.dt);
        self.velocities.par_iter_mut().with_min_len(4096).for_each(|v| *v += pull);
        self.velocities.len()
    }

    /// Moves all particles by their velocities, which air slows.
    pub(crate) fn drift(&mut self) -> usize {
        let (dt, top_speed, kept) = (self.dt, self.top_speed, 1.0 - DRAG * self.dt);
        let drift = |(x, before, v): (&mut DVec3, &mut DVec3, &mut DVec3)| {
            *v = v.clamp_length_max(top_speed) * kept;
            *before = *x;
            *x += *v * dt;
        };
        let particles = (&mut self.positions, &mut self.before, &mut self.velocities);
        particles.into_par_iter().with_min_len(4096).for_each(drift);
        self.positions.len()
    }

    /// Puts each particle, which moved from `before` to `now`, where `touch(before, now)` says.
    /// Gives the number of those that this moves.
    pub(crate) fn touch(&mut self, touch: impl Fn(DVec3, DVec3) -> DVec3 + Sync) -> usize {
        let touched = |(x, &before): (&mut DVec3, &DVec3)| {
            let to = touch(before, *x);
            usize::from(std::mem::replace(x, to) != to)
        };
        (&mut self.positions, &self.before).into_par_iter().with_min_len(4096).map(touched).sum()
    }

    /// Makes the velocities those of the way that all particles have gone in this step.
    pub(crate) fn set_velocities(&mut self) {
        let dt = self.dt;
        let particles = (&mut self.velocities, &self.positions, &self.before).into_par_iter();
        particles.with_min_len(4096).for_each(|(v, &x, &before)| *v = (x - before) / dt);
    }

    /// One sweep over all distance constraints, whose number it gives.
    ///
    /// A row owns the constraints to itself and to the next two rows. Strips of four rows serve the
    /// two rows they begin with; then strips that begin two rows later serve the others.
    pub(crate) fn hold_together(&mut self) -> usize {
        let (side, dt) = (self.side, self.dt);
        let (one, two) = (self.spacing, 2.0 * self.spacing);
        let diagonal = self.spacing * std::f64::consts::SQRT_2;
        let [stretch, shear, bend] = [STRETCH, SHEAR, BEND].map(|c| c / (dt * dt));
        // The ends of each kind of constraint, counted from a particle; the columns and rows that
        // it reaches over; its length, and its compliance over the step squared.
        let kinds = [
            ([0, 1], [1, 0], one, stretch),
            ([0, side], [0, 1], one, stretch),
            ([0, side + 1], [1, 1], diagonal, shear),
            ([1, side], [1, 1], diagonal, shear),
            ([0, 2], [2, 0], two, bend),
            ([0, 2 * side], [0, 2], two, bend),
        ];
        let sweep = |strip: &mut [DVec3]| {
            let (mut count, rows) = (0, strip.len() / side);
            for (row, column) in (0..rows.min(2)).flat_map(|row| (0..side).map(move |column| (row, column))) {
                for &(ends, [across, down], rest, give) in &kinds {
                    if column + across < side && row + down < rows {
                        let [i, j] = ends.map(|end| row * side + column + end);
                        hold(strip, i, j, rest, give);
                        count += 1;
                    }
                }
            }
            count
        };
        let mut pass =
            |first: usize| self.positions[first * side..].par_chunks_mut(4 * side).map(sweep).sum::<usize>();
        pass(0) + pass(2)
    }

    /// Moves particles of folds that are too close apart, all at once, and slows them relative to
    /// each other. Gives the number of those that it moves.
    pub(crate) fn keep_folds_apart(&mut self) -> usize {
        const FRICTION: f64 = 0.1;
        let thickness = self.thickness;
        let (now, before, neighbours) = (&self.positions, &self.before, &self.neighbours);
        let moved_by = |i: usize| {
            let (mut sum, mut count) = (DVec3::ZERO, 0.0_f64);
            for j in neighbours[i].iter().map(|&j| j as usize) {
                let apart = now[i] - now[j];
                let squared = apart.length_squared();
                if squared < thickness * thickness && squared > 0.0 {
                    let distance = squared.sqrt();
                    let slip = (now[i] - before[i]) - (now[j] - before[j]);
                    sum += apart * (0.5 * (thickness - distance) / distance) - slip * (0.5 * FRICTION);
                    count += 1.0;
                }
            }
            // Each pair alone would be resolved fully; their mean is stable where many act.
            sum / count.max(1.0)
        };
        let moves: Vec<DVec3> = (0..now.len()).into_par_iter().with_min_len(1024).map(moved_by).collect();
        for (x, &m) in self.positions.iter_mut().zip(&moves) {
            *x += m;
        }
        moves.iter().filter(|&&m| m != DVec3::ZERO).count()
    }

    /// Root of the mean square of the strain of the edges along rows and columns, and the greatest
    /// strain.
    pub(crate) fn strain(&self) -> (f64, f64) {
        let (mut sum, mut most, mut count) = (0.0, 0.0_f64, 0);
        for i in 0..self.positions.len() {
            let right = (i + 1) % self.side != 0;
            let below = i + self.side < self.positions.len();
            for j in [right.then_some(i + 1), below.then_some(i + self.side)].into_iter().flatten() {
                let strain = self.positions[i].distance(self.positions[j]) / self.spacing - 1.0;
                sum += strain * strain;
                most = most.max(strain);
                count += 1;
            }
        }
        ((sum / f64::from(count)).sqrt(), most)
    }
}

/// Moves two particles of equal mass towards `rest` apart; `give` is the compliance over the step
/// squared.
fn hold(x: &mut [DVec3], i: usize, j: usize, rest: f64, give: f64) {
    let apart = x[j] - x[i];
    let length = apart.length();
    if length > 0.0 {
        let m = apart * ((length - rest) / (length * (2.0 + give)));
        x[i] += m;
        x[j] -= m;
    }
}
