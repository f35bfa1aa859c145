//! Answers of a tree against exact arithmetic. A check gives what is wrong as text, so that tests
//! can assert that seeded defects are found.

use std::collections::{BTreeMap, BTreeSet};

use crate::adaptor::{Hit, Line, Mesh, PlainTree, Subject, Test, Way};
use crate::arithmetic::{Passes, Point};
use crate::rounding::{Verdict, judge};

/// The documented greatest height of a tree.
const MAX_HEIGHT: u32 = 96;

/// What was done.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tally {
    /// Exact tests of a ray against a triangle.
    pub(crate) exact_tests: u64,
    /// Answers compared.
    pub(crate) answers: u64,
    /// Those of them that differ from the exact answer within rounding, by triangle test.
    pub(crate) excused: [u64; 3],
    /// Shadow rays compared.
    pub(crate) shadows: u64,
}

impl Tally {
    pub(crate) fn plus(mut self, other: Self) -> Self {
        self.exact_tests += other.exact_tests;
        self.answers += other.answers;
        self.shadows += other.shadows;
        (0..3).for_each(|i| self.excused[i] += other.excused[i]);
        self
    }
}

type Checked = Result<(), String>;

fn ensure(holds: bool, what: impl FnOnce() -> String) -> Checked {
    if holds { Ok(()) } else { Err(what()) }
}

/// The exact box of some points: `None` without points.
fn around(points: impl Iterator<Item = Point>) -> Option<(Point, Point)> {
    points.fold(None, |found, p| {
        let (low, high) = found.unwrap_or((p, p));
        Some(([0, 1, 2].map(|k| p[k].min(low[k])), [0, 1, 2].map(|k| p[k].max(high[k]))))
    })
}

/// The exact box of a triangle: `None` if a corner is not finite.
pub(crate) fn triangle_box(mesh: &Mesh, i: usize) -> Option<(Point, Point)> {
    if mesh.is_finite(i) { around(mesh.corners(i).into_iter()) } else { None }
}

fn half_area((low, high): (Point, Point)) -> f64 {
    let [x, y, z] = [0, 1, 2].map(|k| f64::from(high[k]) - f64::from(low[k]));
    x * y + y * z + z * x
}

/// What is found below a node: its exact box, its height, and its part of the SAH cost.
struct Below {
    bounds: Option<(Point, Point)>,
    height: u32,
    cost: f64,
}

fn below(tree: &PlainTree, mesh: &Mesh, n: usize, depth: u32, times: &mut [u32]) -> Result<Below, String> {
    ensure(depth <= MAX_HEIGHT, || format!("height: node {n} is {depth} below the root"))?;
    let node = *tree.nodes.get(n).ok_or_else(|| format!("structure: no node {n}"))?;
    let found = if let Some(count) = node.count {
        let slots = tree.order.get(node.first..node.first + count);
        let primitives = slots.ok_or_else(|| format!("structure: leaf {n} covers no slots"))?;
        for &p in primitives {
            *times.get_mut(p).ok_or_else(|| format!("structure: no primitive {p}"))? += 1;
        }
        let corners = primitives.iter().filter(|&&p| mesh.is_finite(p)).flat_map(|&p| mesh.corners(p));
        let bounds = around(corners);
        Below { bounds, height: 0, cost: bounds.map_or(0.0, half_area) * count as f64 }
    } else {
        let l = below(tree, mesh, node.first, depth + 1, times)?;
        let r = below(tree, mesh, node.first + 1, depth + 1, times)?;
        let both = [l.bounds, r.bounds].into_iter().flatten();
        let bounds = around(both.flat_map(|(low, high)| [low, high]));
        let height = 1 + l.height.max(r.height);
        Below { bounds, height, cost: l.cost + r.cost + bounds.map_or(0.0, half_area) }
    };
    let fits = match found.bounds {
        Some((low, high)) => node.min == low && node.max == high,
        None => (0..3).all(|k| node.min[k] > node.max[k]),
    };
    ensure(fits, || {
        format!("box: node {n} has {:?} to {:?}, below it is {:?}", node.min, node.max, found.bounds)
    })?;
    Ok(found)
}

/// The tree holds every primitive once, its boxes are exactly those of what is below them, its
/// height is as it says and within the bound; what the last update reported is so.
pub(crate) fn check_tree(subject: &dyn Subject, mesh: &Mesh) -> Checked {
    let (tree, report) = (subject.tree(), subject.report());
    let n = mesh.triangles.len();
    let mut times = vec![0; n];
    let found = below(&tree, mesh, 0, 0, &mut times)?;
    if let Some(p) = times.iter().position(|&t| t != 1) {
        return Err(format!("structure: primitive {p} is in {} leaves", times[p]));
    }
    ensure(tree.height == found.height, || {
        format!("height: {} is stored, {} is", tree.height, found.height)
    })?;
    if let Some(reported) = report.height {
        ensure(reported == found.height, || format!("height: {reported} is reported, {} is", found.height))?;
    }
    let dropped = (0..n).filter(|&i| !mesh.is_finite(i)).count() as u64;
    ensure(report.dropped == dropped, || format!("dropped: {} reported, {dropped} are", report.dropped))?;
    let cost = found.cost / found.bounds.map_or(1.0, half_area);
    if let Some(reported) = report.cost.filter(|_| cost.is_finite()) {
        ensure((reported - cost).abs() <= 1e-4 * cost, || format!("cost: {reported} reported, {cost} is"))?;
    }
    Ok(())
}

/// The cost of a tree by its structure and the mesh alone.
pub(crate) fn exact_cost(tree: &PlainTree, mesh: &Mesh) -> f64 {
    below(tree, mesh, 0, 0, &mut vec![0; mesh.triangles.len()]).map_or(f64::NAN, |found| found.cost)
}

/// No rotation raised the cost: of every set of primitives that has a subtree of its own both
/// before and after, the subtree costs no more than it did. A rotation keeps the set of the node
/// that it rotates, so that one which loses shows below that node, whatever others gain elsewhere.
pub(crate) fn check_rotations(before: &PlainTree, after: &PlainTree, mesh: &Mesh) -> Checked {
    let (mut old, mut new) = (BTreeMap::new(), BTreeMap::new());
    subtree_costs(before, mesh, 0, &mut old);
    subtree_costs(after, mesh, 0, &mut new);
    for (primitives, cost) in new {
        let Some(&before) = old.get(&primitives) else { continue };
        // Gains are rounded to 24 bits.
        ensure(cost <= before * (1.0 + 1e-6), || {
            format!("rotation: the subtree of {primitives:?} cost {before} and costs {cost}")
        })?;
    }
    Ok(())
}

/// Adds the exact cost of each subtree by the sorted primitives in it. Gives those of node `n`,
/// their box and the cost.
fn subtree_costs(
    tree: &PlainTree,
    mesh: &Mesh,
    n: usize,
    costs: &mut BTreeMap<Vec<usize>, f64>,
) -> (Vec<usize>, Option<(Point, Point)>, f64) {
    let node = tree.nodes[n];
    let (mut primitives, bounds, cost);
    if let Some(count) = node.count {
        primitives = tree.order[node.first..node.first + count].to_vec();
        let corners = primitives.iter().filter(|&&p| mesh.is_finite(p)).flat_map(|&p| mesh.corners(p));
        bounds = around(corners);
        cost = bounds.map_or(0.0, half_area) * count as f64;
    } else {
        let l = subtree_costs(tree, mesh, node.first, costs);
        let r = subtree_costs(tree, mesh, node.first + 1, costs);
        primitives = [l.0, r.0].concat();
        bounds = around([l.1, r.1].into_iter().flatten().flat_map(|(low, high)| [low, high]));
        cost = l.2 + r.2 + bounds.map_or(0.0, half_area);
    }
    primitives.sort_unstable();
    costs.insert(primitives.clone(), cost);
    (primitives, bounds, cost)
}

/// What exact arithmetic says of one ray: for each triangle that it comes near.
pub(crate) struct Truth {
    near: Vec<(usize, Passes, [Verdict; 3])>,
    t_max: f64,
    /// No answer but a hit is right for the tests that are watertight.
    closed: bool,
}

impl Truth {
    pub(crate) fn of(mesh: &Mesh, line: &Line, closed: bool, tally: &mut Tally) -> Self {
        let mut near = Vec::new();
        for i in (0..mesh.triangles.len()).filter(|&i| mesh.is_finite(i)) {
            tally.exact_tests += 1;
            let (exact, verdicts) = judge(line.origin, line.direction, mesh.corners(i));
            if verdicts.iter().any(|v| v.may) {
                near.push((i, exact, verdicts));
            }
        }
        let closed = closed && line.t_max == f32::INFINITY;
        Self { near, t_max: f64::from(line.t_max), closed }
    }

    fn of_test(&self, test: Test) -> impl Iterator<Item = (usize, Passes, Verdict)> {
        self.near.iter().map(move |&(i, exact, verdicts)| (i, exact, verdicts[test as usize]))
    }

    /// Whether no hit at all is a right answer.
    fn allows_none(&self, test: Test) -> Checked {
        let lost = self.of_test(test).find(|(_, _, v)| v.must && v.farthest() <= self.t_max);
        ensure(lost.is_none(), || format!("hit: lost {lost:?}"))?;
        ensure(!self.closed || test == Test::Fast, || "hit: a ray left a closed mesh".into())
    }

    /// Whether an exact hit is there.
    fn is_hit(&self) -> bool {
        self.near.iter().any(|(_, exact, v)| *exact != Passes::Outside && v[2].t <= self.t_max)
    }

    pub(crate) fn check_closest(
        &self,
        mesh: &Mesh,
        test: Test,
        answer: Option<Hit>,
        tally: &mut Tally,
    ) -> Checked {
        tally.answers += 1;
        let Some(hit) = answer else {
            tally.excused[test as usize] += u64::from(self.is_hit());
            return self.allows_none(test);
        };
        let t = f64::from(hit.t);
        let found = self.of_test(test).find(|(i, _, v)| *i == hit.primitive && v.may);
        let Some((_, exact, verdict)) = found else {
            return Err(format!("hit: {hit:?} is none"));
        };
        ensure(t >= 0.0 && t <= self.t_max && t.is_finite(), || format!("distance: {hit:?}"))?;
        // The distance of a triangle in the plane of the ray is not defined.
        let is_defined = !verdict.t.is_nan();
        ensure(!is_defined || (verdict.nearest() <= t && t <= verdict.farthest()), || {
            format!("distance: {hit:?} is at {} give or take {}", verdict.t, verdict.t_error)
        })?;
        let nearer = self.of_test(test).find(|(_, _, v)| v.must && v.farthest() < t);
        ensure(nearer.is_none(), || format!("hit: {hit:?}, but {nearer:?} is nearer"))?;
        let twin = self
            .near
            .iter()
            .find(|(i, ..)| *i < hit.primitive && mesh.corners(*i) == mesh.corners(hit.primitive));
        ensure(twin.is_none(), || format!("order: {hit:?}, but {:?} is the same", twin.map(|t| t.0)))?;
        let first = self.near.iter().filter(|(_, exact, _)| *exact != Passes::Outside).map(|(.., v)| v[2].t);
        let is_exact = exact != Passes::Outside && first.fold(f64::INFINITY, f64::min) >= verdict.t;
        tally.excused[test as usize] += u64::from(!is_exact);
        Ok(())
    }

    pub(crate) fn check_any(&self, test: Test, answer: bool, tally: &mut Tally) -> Checked {
        tally.answers += 1;
        tally.excused[test as usize] += u64::from(answer != self.is_hit());
        if !answer {
            return self.allows_none(test);
        }
        let there =
            self.of_test(test).any(|(_, _, v)| v.may && (v.nearest().is_nan() || v.nearest() <= self.t_max));
        ensure(there, || "hit: any is reported, none is".into())
    }

    /// Every leaf with an exact hit is visited, without any exception for rounding.
    pub(crate) fn check_visited(&self, visited: &[usize], tally: &mut Tally) -> Checked {
        tally.answers += 1;
        let hits = self.near.iter().filter(|(_, exact, v)| *exact != Passes::Outside && v[2].t <= self.t_max);
        for (i, ..) in hits {
            ensure(visited.contains(i), || format!("visit: the leaf of {i} was not visited"))?;
        }
        Ok(())
    }
}

/// All kinds of ray queries, by all tests. `closed`: all rays start inside of a closed mesh.
pub(crate) fn check_rays(
    subject: &dyn Subject,
    mesh: &Mesh,
    lines: &[Line],
    closed: bool,
    tally: &mut Tally,
) -> Checked {
    let truths: Vec<Truth> = lines.iter().map(|line| Truth::of(mesh, line, closed, tally)).collect();
    let at = |line: &Line, error: String| format!("{error}; {line:?}");
    for test in Test::ALL {
        for way in Way::ALL {
            let hits = subject.closest(way, test, lines);
            for ((truth, hit), line) in truths.iter().zip(hits).zip(lines) {
                let checked = truth.check_closest(mesh, test, hit, tally);
                checked.map_err(|e| at(line, format!("{way:?}, {test:?}: {e}")))?;
                let checked = truth.check_any(test, subject.any(way, test, line), tally);
                checked.map_err(|e| at(line, format!("{way:?}, {test:?}, any: {e}")))?;
            }
        }
    }
    for (truth, line) in truths.iter().zip(lines) {
        truth.check_visited(&subject.visited(line), tally).map_err(|e| at(line, e))?;
    }
    Ok(())
}

/// Images by every traversal at every SIMD level: what is hit, and whether light arrives there.
pub(crate) fn check_pictures(
    subject: &dyn Subject,
    mesh: &Mesh,
    test: Test,
    places: [Point; 3],
    width: u32,
    tally: &mut Tally,
) -> Checked {
    let pictures = subject.pictures(test, places, width);
    let lines = pictures.first().map_or(Vec::new(), |picture| picture.lines.clone());
    let truths: Vec<Truth> = lines.iter().map(|line| Truth::of(mesh, line, false, tally)).collect();
    for picture in pictures {
        for (i, (truth, line)) in truths.iter().zip(&lines).enumerate() {
            let at = |e| format!("{}, {test:?}: {e}; {line:?}", picture.name);
            truth.check_closest(mesh, test, picture.hits[i], tally).map_err(at)?;
            let Some(hit) = picture.hits[i] else {
                ensure(!picture.lit[i], || at("shadow: light arrives at nothing".into()))?;
                continue;
            };
            let surface = Surface::new(mesh.corners(hit.primitive), picture.places[i], line);
            surface.check_shadow(mesh, test, places[2], picture.lit[i], tally).map_err(at)?;
        }
    }
    Ok(())
}

type Vector = [f64; 3];

fn less(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn size(v: Vector) -> f64 {
    v.iter().fold(0.0, |most: f64, x| most.max(x.abs()))
}

/// A point of a triangle, seen from one of its sides.
struct Surface {
    corners: [Point; 3],
    point: Vector,
    /// The unit normal of the side that is seen; `None` if rounding may turn it.
    normal: Option<Vector>,
    /// How far rounding may move the normal.
    normal_error: f64,
}

impl Surface {
    fn new(corners: [Point; 3], [u, v]: [f32; 2], line: &Line) -> Self {
        let [a, b, c] = corners.map(|corner| corner.map(f64::from));
        let (b, c) = (less(b, a), less(c, a));
        let point = [0, 1, 2].map(|k| a[k] + b[k] * f64::from(u) + c[k] * f64::from(v));
        let (across, direction) = (cross(b, c), line.direction.map(f64::from));
        let length = dot(across, across).sqrt();
        let normal = across.map(|x| x / length);
        // The edges are rounded once, their product twice, and its length a few times more.
        let normal_error = 8.0 * U * size(b) * size(c) / length;
        let along = dot(normal, direction);
        let is_known = along.abs() > 4.0 * (normal_error + U) * size(direction);
        let normal = is_known.then(|| normal.map(|x| x * -along.signum()));
        Self { corners, point, normal, normal_error }
    }

    /// Light arrives where the side that is seen faces the light and nothing is between. The ray
    /// ends at the point, moved along the normal by 2^-19 of the largest coordinate or distance, as
    /// `rt_cpu` documents; rounding may move its end by a sixth of that, five roundings, on each
    /// axis. A triangle never hides itself: that is what the move is for.
    fn check_shadow(
        &self,
        mesh: &Mesh,
        test: Test,
        light: Point,
        is_lit: bool,
        tally: &mut Tally,
    ) -> Checked {
        let Some(normal) = self.normal else { return Ok(()) };
        let to_light = less(light.map(f64::from), self.point);
        let size = size(self.point).max(size(to_light));
        let facing = dot(normal, to_light);
        if facing.abs() <= 4.0 * (self.normal_error + U) * size {
            return Ok(());
        }
        tally.shadows += 1;
        if facing < 0.0 {
            return ensure(!is_lit, || "shadow: light arrives at the side that faces away".into());
        }
        let off = size / f64::from(1 << 19);
        // A tetrahedron around all places where the end may be. What hides a place is convex.
        let corners = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
        let rays = corners.map(|corner: Vector| {
            let end = [0, 1, 2].map(|k| self.point[k] + off * (normal[k] + 0.5 * corner[k]));
            let direction = less(end, light.map(f64::from)).map(|x| x as f32);
            Truth::of(mesh, &Line { origin: light, direction, t_max: 1.0 }, false, tally)
        });
        let blocks = |ray: &Truth, p: usize| {
            ray.of_test(test).any(|(i, _, v)| i == p && v.must && v.farthest() <= ray.t_max)
        };
        let may_block = |ray: &Truth| {
            let mut others = ray.of_test(test).filter(|&(p, ..)| mesh.corners(p) != self.corners);
            others.any(|(.., v)| v.may && (v.nearest().is_nan() || v.nearest() <= ray.t_max))
        };
        if is_lit {
            let blocker = rays[0].near.iter().find(|&&(p, ..)| rays.iter().all(|ray| blocks(ray, p)));
            return ensure(blocker.is_none(), || format!("shadow: lit through {blocker:?}"));
        }
        ensure(rays.iter().any(may_block), || "shadow: dark, but nothing is between".into())
    }
}

/// The unit roundoff of single precision.
const U: f64 = 1.0 / (1u64 << 24) as f64;

/// The primitive with the nearest box, without limit and with limits at its distance and just
/// above.
pub(crate) fn check_nearest(subject: &dyn Subject, mesh: &Mesh, points: &[Point]) -> Checked {
    let boxes: Vec<_> = (0..mesh.triangles.len()).map(|i| triangle_box(mesh, i)).collect();
    let square = |point: Point, (low, high): (Point, Point)| -> f64 {
        let beyond = |k: usize| f64::from(point[k]) - f64::from(point[k].clamp(low[k], high[k]));
        (0..3).map(|k| beyond(k) * beyond(k)).sum()
    };
    for &point in points {
        let least = boxes.iter().flatten().map(|&aabb| square(point, aabb)).fold(f64::INFINITY, f64::min);
        let found = subject.nearest(point, f32::INFINITY);
        let Some((p, distance)) = found else {
            ensure(least == f64::INFINITY, || format!("nearest: nothing, but {least} to {point:?}"))?;
            continue;
        };
        // A difference, its square and two sums: five roundings.
        let error = 8.0 * U * least;
        let exact = boxes[p].map_or(f64::INFINITY, |aabb| square(point, aabb));
        ensure((exact - least).abs() <= 2.0 * error && (f64::from(distance) - exact).abs() <= error, || {
            format!("nearest: {found:?} to {point:?} is at {exact}, the nearest at {least}")
        })?;
        let below = subject.nearest(point, distance);
        ensure(below.is_none(), || format!("nearest: {below:?} to {point:?}, but none is below the limit"))?;
        let above = subject.nearest(point, distance.next_up());
        ensure(above.is_some_and(|(_, t)| t == distance), || {
            format!("nearest: {above:?} to {point:?}, but {found:?} is below the limit")
        })?;
    }
    Ok(())
}

fn overlap(a: Option<(Point, Point)>, b: Option<(Point, Point)>) -> bool {
    let (Some(a), Some(b)) = (a, b) else { return false };
    (0..3).all(|k| a.0[k] <= b.1[k] && b.0[k] <= a.1[k])
}

/// Queries by boxes, and pairs: each that there is, once; with one primitive a leaf no others.
pub(crate) fn check_boxes(subject: &dyn Subject, mesh: &Mesh, queries: &[(Point, Point)]) -> Checked {
    let n = mesh.triangles.len();
    let boxes: Vec<_> = (0..n).map(|i| triangle_box(mesh, i)).collect();
    let single = subject.tree().nodes.iter().all(|node| node.count.is_none_or(|count| count <= 1));
    for &(low, high) in queries {
        let expected: BTreeSet<usize> = (0..n).filter(|&i| overlap(boxes[i], Some((low, high)))).collect();
        compare(&expected, subject.overlaps(low, high), single).map_err(|e| format!("overlap: {e}"))?;
    }
    let expected = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
    let expected: BTreeSet<_> = expected.filter(|&(a, b)| overlap(boxes[a], boxes[b])).collect();
    let found = subject.pairs().into_iter().map(|(a, b)| (a.min(b), a.max(b))).collect();
    compare(&expected, found, single).map_err(|e| format!("pair: {e}"))
}

fn compare<T: Ord + std::fmt::Debug>(expected: &BTreeSet<T>, found: Vec<T>, only: bool) -> Checked {
    let count = found.len();
    let found: BTreeSet<T> = found.into_iter().collect();
    ensure(found.len() == count, || format!("{count} found, of which {} are different", found.len()))?;
    let lost = expected.difference(&found).next();
    ensure(lost.is_none(), || format!("{lost:?} is lost"))?;
    let more = found.difference(expected).next();
    ensure(!only || more.is_none(), || format!("{more:?} is none"))
}
