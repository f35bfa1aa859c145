//! Rigid bodies that break off, fly, spin, and come to rest: extended position-based dynamics for
//! rigid bodies (Müller et al. 2020, "Detailed Rigid Body Simulation with Extended Position Based
//! Dynamics").
//!
//! Contact with the ground is at corners of the body, with friction and bounce. Contact between
//! bodies is between one sphere each. Every parallel pass reads a snapshot or a single body, so
//! that the result does not depend on the number of threads.

use glam::{DQuat, IVec3, Mat3, Vec3};
use indexmap::IndexSet;
use rayon::prelude::*;

use crate::near::neighbours;
use crate::rigid::Placement;
use crate::shape::Mesh;

pub(crate) const GRAVITY: f32 = 12.0;
const GROUND_FRICTION: f32 = 0.6;
const BOUNCE: f32 = 0.25;
/// Steps between searches for bodies that come close.
const SEARCH: usize = 5;

/// A rigid body and its motion.
pub(crate) struct Body {
    /// Where it is; the rotation is relative to how it was made.
    pub(crate) at: Placement,
    pub(crate) velocity: Vec3,
    pub(crate) spin: Vec3,
    /// Whether it moves freely; if not it stands still and cannot be pushed.
    pub(crate) free: bool,
    pub(crate) mass: f32,
    /// Radius of the sphere about the centre that other bodies touch.
    pub(crate) radius: f32,
    pub(crate) inverse_inertia: Mat3,
    /// Radius of the sphere about the centre that holds it.
    reach: f32,
    /// Points that touch the ground, relative to the centre.
    corners: Vec<Vec3>,
    before: Placement,
    /// Where it would be now without contact.
    predicted: Placement,
}

impl Body {
    /// The body of a closed or open surface of the given mass per area, and the surface relative to
    /// its centre.
    pub(crate) fn new(mut surface: Mesh, mass_per_area: f32) -> (Self, Mesh) {
        let mass_and_center =
            |[a, b, c]: [Vec3; 3]| (0.5 * (b - a).cross(c - a).length() * mass_per_area, (a + b + c) / 3.0);
        let (mut mass, mut center) = (1e-9, Vec3::ZERO);
        for (m, p) in surface.corners().map(mass_and_center) {
            mass += m;
            center += p * m;
        }
        center /= mass;
        surface.positions.iter_mut().for_each(|p| *p -= center);
        let mut inertia = Mat3::ZERO;
        for (m, p) in surface.corners().map(mass_and_center) {
            let outer = Mat3::from_cols(p * p.x, p * p.y, p * p.z);
            inertia += (Mat3::IDENTITY * p.length_squared() - outer) * m;
        }
        let reach = surface.positions.iter().map(|p| p.length()).fold(0.0, f32::max);
        // Keeps a body that is all but a line or a point from spinning without bound.
        inertia += Mat3::IDENTITY * (0.02 * mass * reach * reach + 1e-12);
        let at = Placement { position: center, rotation: DQuat::IDENTITY };
        let body = Self {
            at,
            velocity: Vec3::ZERO,
            spin: Vec3::ZERO,
            free: false,
            mass,
            radius: 0.0,
            inverse_inertia: inertia.inverse(),
            reach,
            corners: extreme_points(&surface.positions),
            before: at,
            predicted: at,
        };
        (body, surface)
    }

    /// Whether it may be in the ground: it is not where it is higher than it is large.
    pub(crate) fn is_low(&self) -> bool {
        self.at.position.y < 1.001 * self.reach
    }

    fn drift(&mut self, dt: f32) {
        self.before = self.at;
        if self.free {
            self.at.position += self.velocity * dt;
            self.turn(self.spin * dt);
        }
        self.predicted = self.at;
    }

    /// Rotates by a small rotation vector in the world.
    fn turn(&mut self, by: Vec3) {
        let q = self.at.rotation;
        self.at.rotation = (q + DQuat::from_vec4((0.5 * by.as_dvec3()).extend(0.0)) * q).normalize();
    }

    /// Pushes the body out of the ground, and adds to its velocities what contact changed in this
    /// step. Gives the number of corners that were below the ground.
    fn touch_ground(&mut self, dt: f32) -> usize {
        if !self.free {
            return 0;
        }
        let mut contacts = 0;
        let (velocity, spin) = (self.velocity, self.spin);
        let mut lowest: Option<Vec3> = None;
        let corners = if self.is_low() { self.corners.len() } else { 0 };
        for k in 0..corners {
            let corner = self.corners[k];
            let arm = self.at.turned(corner);
            let depth = -(self.at.position.y + arm.y);
            if depth > 0.0 {
                contacts += 1;
                let normal_push = depth / self.give(arm, Vec3::Y);
                self.push(arm, Vec3::Y * normal_push);
                let arm = self.at.turned(corner);
                let slip = (self.at.position + arm) - (self.before.position + self.before.turned(corner));
                let along = Vec3::new(slip.x, 0.0, slip.z);
                if let Some(direction) = along.try_normalize() {
                    let needed = along.length() / self.give(arm, direction);
                    self.push(arm, -direction * needed.min(GROUND_FRICTION * normal_push));
                }
                if lowest.is_none_or(|l| arm.y < l.y) {
                    lowest = Some(arm);
                }
            }
        }
        // What contact changes is added: the whole way over the time of a small step would be a
        // speed rounded to nothing.
        self.velocity += (self.at.position - self.predicted.position) / dt;
        if self.at.rotation != self.predicted.rotation {
            let turned = self.at.rotation * self.predicted.rotation.conjugate();
            self.spin += turned.xyz().as_vec3() * (2.0 * turned.w.signum() as f32 / dt);
        }
        if let Some(arm) = lowest {
            let arriving = (velocity + spin.cross(arm)).y;
            let leaving = (self.velocity + self.spin.cross(arm)).y;
            // Slow bodies do not bounce, so that they come to rest.
            let wanted = if arriving < -1.0 { -BOUNCE * arriving } else { leaving.min(0.0) };
            let impulse = Vec3::Y * ((wanted - leaving) / self.give(arm, Vec3::Y));
            self.velocity += impulse / self.mass;
            self.spin += self.inverse_inertia_in_world(arm.cross(impulse));
            self.spin *= 1.0 - (4.0 * dt).min(1.0);
        }
        contacts
    }

    /// How far a point moves along a direction per unit of impulse there.
    fn give(&self, arm: Vec3, direction: Vec3) -> f32 {
        let lever = arm.cross(direction);
        1.0 / self.mass + lever.dot(self.inverse_inertia_in_world(lever))
    }

    fn inverse_inertia_in_world(&self, torque: Vec3) -> Vec3 {
        self.at.turned(self.inverse_inertia * self.at.turned_back(torque))
    }

    fn push(&mut self, arm: Vec3, impulse: Vec3) {
        self.at.position += impulse / self.mass;
        self.turn(self.inverse_inertia_in_world(arm.cross(impulse)));
    }
}

/// The points that are farthest in 98 directions: from the centre of a cube to a grid of 5 by 5
/// points on each side.
fn extreme_points(points: &[Vec3]) -> Vec<Vec3> {
    let cube = (0..125).map(|i| IVec3::new(i / 25, i / 5 % 5, i % 5) - 2);
    let directions = cube.filter(|d| d.abs().max_element() == 2).map(IVec3::as_vec3);
    let farthest = |d: Vec3| (0..points.len()).max_by(|&i, &j| points[i].dot(d).total_cmp(&points[j].dot(d)));
    let chosen: IndexSet<usize> = directions.filter_map(farthest).collect();
    chosen.into_iter().map(|i| points[i]).collect()
}

/// Bodies under gravity above the ground at y = 0. The last body may be much larger than the
/// others.
pub(crate) struct Bodies {
    pub(crate) bodies: Vec<Body>,
    /// Seconds of a step.
    pub(crate) dt: f32,
    /// For each body but the last, those that may touch it until the next search.
    neighbours: Vec<Vec<u32>>,
}

impl Bodies {
    /// `bodies` where they stand; all but the last get the largest spheres that do not touch each
    /// other, up to `limit`.
    pub(crate) fn new(mut bodies: Vec<Body>, limit: f32, dt: f32) -> Self {
        let shards = bodies.len() - 1;
        let centers: Vec<Vec3> = bodies[..shards].iter().map(|b| b.at.position).collect();
        let neighbours = neighbours(&centers, 2.0 * limit, |_, _| true);
        for ((body, center), near) in bodies.iter_mut().zip(&centers).zip(&neighbours) {
            let distances = near.iter().map(|&j| center.distance(centers[j as usize]));
            body.radius = 0.5 * distances.fold(2.0 * limit, f32::min);
        }
        Self { bodies, dt, neighbours }
    }

    /// Accelerates what is free, and gives its number.
    pub(crate) fn fall(&mut self) -> usize {
        let speed = GRAVITY * self.dt;
        let free = self.bodies.iter_mut().filter(|b| b.free);
        free.map(|b| b.velocity.y -= speed).count()
    }

    /// Moves all bodies by their velocities.
    pub(crate) fn drift(&mut self) -> usize {
        let dt = self.dt;
        self.bodies.par_iter_mut().with_min_len(512).for_each(|b| b.drift(dt));
        self.bodies.len()
    }

    /// Resolves contacts of the bodies with one another and with the ground in the step of this
    /// number, and gives their number.
    pub(crate) fn touch(&mut self, step: usize) -> usize {
        let shards = self.bodies.len() - 1;
        if step.is_multiple_of(SEARCH) {
            let bodies = &self.bodies[..shards];
            let centers: Vec<Vec3> = bodies.iter().map(|b| b.at.position).collect();
            let largest = bodies.iter().map(|b| b.radius).fold(0.0, f32::max);
            self.neighbours = neighbours(&centers, 2.5 * largest, |i, _| bodies[i].free);
        }
        let pushes: Vec<(Vec3, Vec3)> =
            (0..shards).into_par_iter().with_min_len(512).map(|i| self.pushed(i)).collect();
        for (body, &(push, shift)) in self.bodies.iter_mut().zip(&pushes) {
            body.at.position += push + shift;
            body.before.position += shift;
            body.predicted.position += shift;
        }
        let dt = self.dt;
        let corners: usize = self.bodies.par_iter_mut().with_min_len(256).map(|b| b.touch_ground(dt)).sum();
        pushes.iter().filter(|&&pushes| pushes != (Vec3::ZERO, Vec3::ZERO)).count() + corners
    }

    /// How far its neighbours and the last body push a body, and how far they shift it besides,
    /// which changes no velocity.
    ///
    /// A push undoes that part of an overlap by which the two approached each other in this step.
    /// What overlapped before is shifted apart: as a push it would become speed, the more the
    /// smaller the step.
    fn pushed(&self, i: usize) -> (Vec3, Vec3) {
        let b = &self.bodies[i];
        if !b.free {
            return (Vec3::ZERO, Vec3::ZERO);
        }
        let last = self.bodies.len() - 1;
        let (mut push, mut shift, mut count) = (Vec3::ZERO, Vec3::ZERO, 0.0_f32);
        for j in self.neighbours[i].iter().map(|&j| j as usize).chain([last]) {
            let other = &self.bodies[j];
            let apart = b.at.position - other.at.position;
            let overlap = b.radius + other.radius - apart.length();
            if overlap > 0.0
                && let Some(normal) = apart.try_normalize()
            {
                let share = if other.free { other.mass / (other.mass + b.mass) } else { 1.0 };
                let slip = (b.at.position - b.before.position) - (other.at.position - other.before.position);
                // Half of the overlap: bodies are also pushed from behind.
                let approach = (-slip.dot(normal)).clamp(0.0, 0.5 * overlap);
                // A tenth of the slip goes, as friction.
                push += (normal * approach - 0.1 * slip) * share;
                shift += normal * ((0.5 * overlap - approach) * share);
                count += 1.0;
            }
        }
        (push / count.max(1.0), shift / count.max(1.0))
    }
}
