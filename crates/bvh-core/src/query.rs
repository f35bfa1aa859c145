//! Queries through closures: overlapping boxes, overlapping pairs, rays, nearest primitive.

use std::ops::{AddAssign, ControlFlow};

use crate::{Aabb, Bvh, MAX_HEIGHT, Node, Primitives, Ray};

/// Entries of a stack that keeps one node for each level.
const STACK: usize = MAX_HEIGHT as usize + 1;

/// The work of queries: what they cost, in the unit of the SAH. Sums are those of several queries.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Visits {
    /// Number of queries.
    pub queries: u64,
    /// Inner nodes opened by them; in a pair query, once for each pair of nodes.
    pub nodes: u64,
    /// Primitives tested by them.
    pub primitives: u64,
}

impl AddAssign for Visits {
    fn add_assign(&mut self, other: Self) {
        self.queries += other.queries;
        self.nodes += other.nodes;
        self.primitives += other.primitives;
    }
}

impl Bvh {
    /// Calls `found` with the number of each primitive whose box overlaps `query` (touching
    /// counts), until it breaks.
    ///
    /// Each primitive comes once, in no particular order. A dropped primitive is not found, and a
    /// query that is empty or has a NaN finds nothing. `primitives` are those of the last update;
    /// they are asked only about leaves of several primitives. O(log n + found) for scattered
    /// primitives, O(n) at worst. Allocates nothing.
    ///
    /// # Panics
    /// May panic if there are fewer `primitives` than the tree holds.
    ///
    /// ```
    /// use bvh_core::{Aabb, Bvh, Node, Vec3};
    /// use std::ops::ControlFlow;
    ///
    /// let boxes = [Aabb::new(Vec3::ZERO, Vec3::ONE); 1];
    /// let bvh = Bvh::new(&[Node::leaf(boxes[0], 0, 1), Node::NOTHING], vec![0])?;
    /// let mut is_blocked = false;
    /// bvh.for_each_overlap(&boxes, &boxes[0], |_| {
    ///     is_blocked = true;
    ///     ControlFlow::Break(())
    /// });
    /// assert!(is_blocked);
    /// # Ok::<(), bvh_core::Malformed>(())
    /// ```
    pub fn for_each_overlap<P: Primitives + ?Sized>(
        &self,
        primitives: &P,
        query: &Aabb,
        mut found: impl FnMut(usize) -> ControlFlow<()>,
    ) -> Visits {
        // No distances: neither box is nearer, and the limit stays.
        let enters = |aabb: &Aabb, _| aabb.overlaps(query).then_some(0.0);
        let test = |leaf: &Node, p, limit| {
            let overlaps = leaf.count() == 1 || primitives.aabb(p).overlaps(query);
            if overlaps && found(p).is_break() {
                ControlFlow::Break(limit)
            } else {
                ControlFlow::Continue(limit)
            }
        };
        self.walk_nearest_first(0.0, enters, 1.0, test).1
    }

    /// Calls `found` once with each pair of different primitives whose boxes overlap (touching
    /// counts), until it breaks: the broad phase of a collision loop.
    ///
    /// Pairs come in no particular order, and so do the two of a pair. A dropped primitive is in no
    /// pair. `primitives` are those of the last update; they are asked only about leaves of several
    /// primitives. O(n + pairs) for scattered primitives. Allocates nothing.
    ///
    /// # Panics
    /// May panic if there are fewer `primitives` than the tree holds.
    ///
    /// ```
    /// use bvh_core::{Aabb, Bvh, Node, Vec3};
    /// use std::ops::ControlFlow;
    ///
    /// let boxes = [0.0, 0.5, 9.0].map(|x| Aabb::new(Vec3::X * x, Vec3::X * x + Vec3::ONE));
    /// let all = boxes[0].union(boxes[2]);
    /// let bvh = Bvh::new(&[Node::leaf(all, 0, 3), Node::NOTHING], vec![0, 1, 2])?;
    /// let mut pairs = Vec::new();
    /// bvh.for_each_pair(&boxes, |a, b| {
    ///     pairs.push((a, b));
    ///     ControlFlow::Continue(())
    /// });
    /// assert_eq!(pairs, [(0, 1)]);
    /// # Ok::<(), bvh_core::Malformed>(())
    /// ```
    pub fn for_each_pair<P: Primitives + ?Sized>(
        &self,
        primitives: &P,
        found: impl FnMut(usize, usize) -> ControlFlow<()>,
    ) -> Visits {
        self.walk_pairs::<_, _, true>(primitives, self, primitives, |_, _| true, found)
    }

    /// Does what [`for_each_pair`](Self::for_each_pair) does, but leaves out pairs of primitives
    /// whose leaves are static ([`set_dynamic`](Self::set_dynamic)), two in one leaf among them.
    /// Two subtrees that are both static are not visited: O(k log n + pairs) for k scattered dynamic
    /// primitives.
    ///
    /// # Panics
    /// As [`for_each_pair`](Self::for_each_pair).
    ///
    /// ```
    /// use bvh_core::{Aabb, Bvh, Node, Vec3};
    /// use std::ops::ControlFlow;
    ///
    /// let boxes = [Aabb::new(Vec3::ZERO, Vec3::ONE); 3];
    /// let leaf = |slot| Node::leaf(boxes[0], slot, 1);
    /// let ab = Node::parent(&leaf(0), &leaf(1), 4);
    /// let nodes = [Node::parent(&ab, &leaf(2), 2), Node::NOTHING, ab, leaf(2), leaf(0), leaf(1)];
    /// let mut bvh = Bvh::new(&nodes, vec![0, 1, 2])?;
    /// bvh.set_dynamic(|p| p == 2);
    /// let mut pairs = 0;
    /// bvh.for_each_dynamic_pair(&boxes, |a, b| {
    ///     assert!(a == 2 || b == 2);
    ///     pairs += 1;
    ///     ControlFlow::Continue(())
    /// });
    /// assert_eq!(pairs, 2);
    /// # Ok::<(), bvh_core::Malformed>(())
    /// ```
    pub fn for_each_dynamic_pair<P: Primitives + ?Sized>(
        &self,
        primitives: &P,
        found: impl FnMut(usize, usize) -> ControlFlow<()>,
    ) -> Visits {
        let is_wanted = |a: &Node, b: &Node| a.is_dynamic() || b.is_dynamic();
        self.walk_pairs::<_, _, true>(primitives, self, primitives, is_wanted, found)
    }

    /// Calls `found` once with each pair of a primitive of this tree and one of the tree `other`
    /// whose boxes overlap (touching counts), until it breaks: what moves against a static world,
    /// say.
    ///
    /// `found` gets a primitive of this tree first and one of the other second; pairs come in no
    /// particular order. A tree and itself give each primitive with itself, and all other pairs
    /// twice. A dropped primitive is in no pair. `primitives` are those of the last update of this
    /// tree, `others` those of the other; they are asked only about leaves of several primitives.
    /// O(n + m + pairs) for scattered primitives, n and m of them. Allocates nothing.
    ///
    /// # Panics
    /// May panic if there are fewer `primitives` or `others` than the trees hold.
    ///
    /// ```
    /// use bvh_core::{Aabb, Bvh, Node, Vec3};
    /// use std::ops::ControlFlow;
    ///
    /// let unit = Aabb::new(Vec3::ZERO, Vec3::ONE);
    /// let (ball, world) = ([unit], [Aabb::new(Vec3::X * 9.0, Vec3::X * 10.0), unit.grown(5.0)]);
    /// let tree = Bvh::new(&[Node::leaf(ball[0], 0, 1), Node::NOTHING], vec![0])?;
    /// let all = world[0].union(world[1]);
    /// let world_tree = Bvh::new(&[Node::leaf(all, 0, 2), Node::NOTHING], vec![0, 1])?;
    /// let mut pairs = Vec::new();
    /// tree.for_each_pair_between(&ball, &world_tree, &world, |a, b| {
    ///     pairs.push((a, b));
    ///     ControlFlow::Continue(())
    /// });
    /// assert_eq!(pairs, [(0, 1)]);
    /// # Ok::<(), bvh_core::Malformed>(())
    /// ```
    pub fn for_each_pair_between<P: Primitives + ?Sized, Q: Primitives + ?Sized>(
        &self,
        primitives: &P,
        other: &Self,
        others: &Q,
        found: impl FnMut(usize, usize) -> ControlFlow<()>,
    ) -> Visits {
        self.walk_pairs::<_, _, false>(primitives, other, others, |_, _| true, found)
    }

    /// The pairs of this tree and another, or if `WITHIN` those within this tree, which is the
    /// other then, too. Pairs of nodes that are not wanted are left out with all below them.
    fn walk_pairs<P: Primitives + ?Sized, Q: Primitives + ?Sized, const WITHIN: bool>(
        &self,
        primitives: &P,
        other: &Self,
        others: &Q,
        is_wanted: impl Fn(&Node, &Node) -> bool,
        mut found: impl FnMut(usize, usize) -> ControlFlow<()>,
    ) -> Visits {
        let mut visits = Visits { queries: 1, ..Visits::default() };
        // Within a tree two equal numbers stand for the pairs within a subtree. Of those one pends
        // for each level above and two at the present level; below them pend two different nodes,
        // one for each level of either: at most 2 * MAX_HEIGHT + 1 in all.
        let mut stack = [(0, 0); 2 * STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (a, b) = stack[top];
            let (na, nb) = (&self.nodes()[a as usize], &other.nodes()[b as usize]);
            let is_one = WITHIN && a == b;
            if !is_wanted(na, nb) || (!is_one && !na.aabb().overlaps(&nb.aabb())) {
                continue;
            }
            let mut push = |pair| {
                stack[top] = pair;
                top += 1;
            };
            let (l, r) = (na.first() as u32, na.first() as u32 + 1);
            // The larger one, so that the boxes compared stay alike in size.
            let opens_a =
                !na.is_leaf() && (is_one || nb.is_leaf() || na.aabb().half_area() >= nb.aabb().half_area());
            if opens_a && is_one {
                [(l, l), (r, r), (l, r)].into_iter().for_each(&mut push);
            } else if opens_a {
                [(l, b), (r, b)].into_iter().for_each(&mut push);
            } else if !nb.is_leaf() {
                let first = nb.first() as u32;
                [(a, first), (a, first + 1)].into_iter().for_each(&mut push);
            } else {
                for (i, &x) in self.primitives(na).iter().enumerate() {
                    let own = if na.count() == 1 { na.aabb() } else { primitives.aabb(x as usize) };
                    for &y in &other.primitives(nb)[if is_one { i + 1 } else { 0 }..] {
                        visits.primitives += 1;
                        let its = if nb.count() == 1 { nb.aabb() } else { others.aabb(y as usize) };
                        if own.overlaps(&its) && found(x as usize, y as usize).is_break() {
                            return visits;
                        }
                    }
                }
                continue;
            }
            visits.nodes += 1;
        }
        visits
    }

    /// Casts a ray: calls `test` with the number of each primitive in a leaf that the ray enters
    /// before `t_max`, near leaves first. Gives the last `t_max` and the work.
    ///
    /// `test` gets the present `t_max` and gives the next one: `Continue` with the distance of a
    /// nearer hit, or with the same `t_max`, finds the closest hit; `Break` ends the walk with any
    /// hit. Distances are in multiples of the ray's direction.
    ///
    /// An invalid ray, or a `t_max` that is negative or NaN, meets nothing. Rounding never skips a
    /// leaf, not even one exactly at `t_max` (but for what [`Ray::enters`] excepts), so a few
    /// leaves just behind it may be tested. O(log n) for a ray that meets little, O(n) at worst.
    /// Allocates nothing.
    ///
    /// ```
    /// use bvh_core::{Aabb, Bvh, Node, Ray, Vec3};
    /// use std::ops::ControlFlow::{Break, Continue};
    ///
    /// let unit = Aabb::new(Vec3::ZERO, Vec3::ONE);
    /// let bvh = Bvh::new(&[Node::leaf(unit, 0, 1), Node::NOTHING], vec![0])?;
    /// let ray = Ray::new(Vec3::new(0.5, 0.5, -2.0), Vec3::Z);
    /// // The primitive is its box.
    /// let mut closest = None;
    /// let (t, visits) = bvh.cast_ray(&ray, f32::INFINITY, |p, t_max| match ray.enters(&unit, t_max) {
    ///     Some(t) if t < t_max => {
    ///         closest = Some(p);
    ///         Continue(t)
    ///     }
    ///     _ => Continue(t_max),
    /// });
    /// assert_eq!((t, closest, visits.queries), (2.0, Some(0), 1));
    ///
    /// let mut is_hit = false;
    /// bvh.cast_ray(&ray, 1.0, |_, t_max| {
    ///     is_hit = true;
    ///     Break(t_max)
    /// });
    /// assert!(!is_hit, "the box begins at 2");
    /// # Ok::<(), bvh_core::Malformed>(())
    /// ```
    pub fn cast_ray(
        &self,
        ray: &Ray,
        t_max: f32,
        mut test: impl FnMut(usize, f32) -> ControlFlow<f32, f32>,
    ) -> (f32, Visits) {
        let test = |_: &Node, p, t_max| match test(p, t_max) {
            ControlFlow::Continue(t) if t.is_nan() || t < 0.0 => ControlFlow::Break(t),
            next => next,
        };
        self.walk_nearest_first(t_max, |aabb, t_max| ray.enters(aabb, t_max), Ray::WIDEN, test)
    }

    /// Finds the primitive of least distance below `max` by walking near boxes first. Gives its
    /// number and distance, if there is one, and the work.
    ///
    /// `to_box` is a lower bound of the distance of everything in a box, and `to_primitive` the
    /// distance of a primitive, which may stop early once it exceeds the limit it is given. Any
    /// unit will do, squared distances too, and distances may be negative. A NaN is never nearer.
    /// Of equal distances the first one met is taken. O(log n) for scattered primitives, O(n) at
    /// worst. Allocates nothing.
    ///
    /// To ask whether anything is within `max`, give negative infinity as the distance of the first
    /// primitive that is: nothing is nearer, so the walk ends. To ask for what meets a shape other
    /// than a box, such as a frustum, give 0 for boxes that may meet it and infinity for others.
    ///
    /// ```
    /// use bvh_core::{Aabb, Bvh, Node, Vec3};
    ///
    /// let boxes = [0.0, 5.0].map(|x| Aabb::new(Vec3::X * x, Vec3::X * x + Vec3::ONE));
    /// let (l, r) = (Node::leaf(boxes[0], 0, 1), Node::leaf(boxes[1], 1, 1));
    /// let bvh = Bvh::new(&[Node::parent(&l, &r, 2), Node::NOTHING, l, r], vec![0, 1])?;
    /// let point = Vec3::new(4.0, 0.5, 0.5);
    /// let (nearest, _) = bvh.nearest(
    ///     f32::INFINITY,
    ///     |aabb| aabb.distance_squared(point),
    ///     |p, _| boxes[p].distance_squared(point),
    /// );
    /// assert_eq!(nearest, Some((1, 1.0)));
    /// # Ok::<(), bvh_core::Malformed>(())
    /// ```
    pub fn nearest(
        &self,
        max: f32,
        to_box: impl Fn(&Aabb) -> f32,
        mut to_primitive: impl FnMut(usize, f32) -> f32,
    ) -> (Option<(usize, f32)>, Visits) {
        let mut nearest = None;
        let enters = |aabb: &Aabb, max| Some(to_box(aabb)).filter(|&distance| distance < max);
        let (_, visits) = self.walk_nearest_first(max, enters, 1.0, |_, p, max| {
            let distance = to_primitive(p, max);
            if distance < max {
                nearest = Some((p, distance));
            }
            ControlFlow::Continue(distance.min(max))
        });
        (nearest, visits)
    }

    /// Calls `test` with each leaf whose box `enters` below the limit that `test` gave last and
    /// each primitive in it: near boxes first, and the left one of two equally near. A node waits
    /// on the stack until its entry exceeds `widen` limits.
    #[inline]
    fn walk_nearest_first(
        &self,
        mut limit: f32,
        enters: impl Fn(&Aabb, f32) -> Option<f32>,
        widen: f32,
        mut test: impl FnMut(&Node, usize, f32) -> ControlFlow<f32, f32>,
    ) -> (f32, Visits) {
        let nodes = self.nodes();
        let mut visits = Visits { queries: 1, ..Visits::default() };
        let mut stack = [(0.0, 0); STACK];
        let mut top = 0;
        let mut next = enters(&self.root().aabb(), limit).map(|t| (t, 0));
        while let Some((t, n)) = next.take() {
            let node = &nodes[n as usize];
            if t > limit * widen {
                // A nearer hit was found since.
            } else if node.is_leaf() {
                for &p in self.primitives(node) {
                    visits.primitives += 1;
                    match test(node, p as usize, limit) {
                        ControlFlow::Continue(t) => limit = t,
                        ControlFlow::Break(t) => return (t, visits),
                    }
                }
            } else {
                visits.nodes += 1;
                let (l, r) = (node.first() as u32, node.first() as u32 + 1);
                let enters = |n: u32| enters(&nodes[n as usize].aabb(), limit).map(|t| (t, n));
                next = match (enters(l), enters(r)) {
                    (Some(l), Some(r)) => {
                        let (near, far) = if r.0 < l.0 { (r, l) } else { (l, r) };
                        stack[top] = far;
                        top += 1;
                        Some(near)
                    }
                    (l, r) => l.or(r),
                };
            }
            if next.is_none() && top > 0 {
                top -= 1;
                next = Some(stack[top]);
            }
        }
        (limit, visits)
    }
}
