//! The camera: what the sidecar and the caller say of it, and what they leave open.

use std::ops::RangeInclusive;

use glam::{DVec3, Vec3A};
use rayon::prelude::*;

use super::{exact::length_squared, units::Placement};
use crate::{Camera, Triangle};

/// In degrees, of a camera for which nobody says it: as a lens of 50 mm sees the longer
/// side of a small picture, without much distortion.
const DEFAULT_FOV: f32 = 40.0;
/// tan(`DEFAULT_FOV` / 2). A constant, as machines differ in their tangents, and the
/// camera that frames a scene is part of its fingerprint.
const TAN_HALF_FOV: f64 = 0.363_970_234_266_202_4;
/// From the scene to a camera that nobody has placed. Models in OBJ files have y up and
/// face +z, as Blender and most other programs write and show them: the camera looks from
/// there, a little from the right and from above.
const TOWARDS_CAMERA: DVec3 = DVec3::new(0.6, 0.5, 1.0);
/// How much larger than the scene the picture is.
const MARGIN: f64 = 1.06;
/// Each step leaves about a third of the error of a view of 100 degrees, and far less of
/// narrow ones.
const STEPS: usize = 12;
/// Sine of the least angle between the view and the direction up: what is nearer
/// leaves f32 three digits to say which way is up.
const LEAST_UP_SINE: f64 = 1e-4;
/// Lengths of the direction up that f32 can square and multiply with others.
const UP_LENGTHS: RangeInclusive<f32> = 1e-6..=1e6;

/// What is known of a camera; the rest is chosen so that it sees the scene. Positions are
/// in the coordinates of the OBJ file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct View {
    /// The pinhole.
    pub position: Option<[f64; 3]>,
    /// The middle of the picture.
    pub target: Option<[f64; 3]>,
    /// A direction that points up in the picture; +y by default.
    pub up: Option<[f32; 3]>,
    /// The angle between the upper and the lower edge of the picture, in degrees.
    pub vertical_fov: Option<f32>,
}

impl View {
    /// The same, where `self` leaves something open as `other` says.
    pub(super) fn or(self, other: Self) -> Self {
        Self {
            position: self.position.or(other.position),
            target: self.target.or(other.target),
            up: self.up.or(other.up),
            vertical_fov: self.vertical_fov.or(other.vertical_fov),
        }
    }

    /// Whether a part, as [`Self::camera`] names it, is given.
    pub(super) fn has(&self, part: &str) -> bool {
        match part {
            "position" => self.position.is_some(),
            "target" => self.target.is_some(),
            "up" => self.up.is_some(),
            _ => self.vertical_fov.is_some(),
        }
    }

    /// The camera, for triangles that are placed. `aspect` is the width of the picture divided by
    /// its height.
    ///
    /// # Errors
    /// What is wrong: the name of the part, and what it must be.
    pub(super) fn camera(
        &self,
        triangles: &[Triangle],
        placement: &Placement,
        aspect: f64,
    ) -> Result<Camera, (&'static str, &'static str)> {
        let fov = self.vertical_fov.unwrap_or(DEFAULT_FOV);
        if !(fov > 0.0 && fov < 180.0) {
            return Err(("vertical_fov", "must lie between 0 and 180 degrees"));
        }
        let [position, target] = [self.position, self.target].map(|point| point.map(DVec3::from));
        for (name, point) in [("position", position), ("target", target)] {
            if point.is_some_and(|point| !point.is_finite()) {
                return Err((name, "must be finite"));
            }
        }
        let (low, high) = crate::scene::bounds(triangles);
        let middle = (low.as_dvec3() + high.as_dvec3()) / 2.0;
        let given = target.map(|target| placement.point(target));
        let (target, position) = match position {
            Some(position) => (given.unwrap_or(middle), placement.point(position)),
            None => {
                let frame = Frame::new(triangles, given.unwrap_or(middle), fov, aspect);
                let target = given.unwrap_or_else(|| frame.centre());
                (target, frame.position(target))
            }
        };
        let camera = Camera {
            position: position.as_vec3a(),
            target: target.as_vec3a(),
            up: up(self.up.map(Vec3A::from), target - position)?,
            vertical_fov: fov,
        };
        if camera.position == camera.target {
            return Err(("target", "must differ from position"));
        }
        if !Placement::is_distinct(&camera, triangles) {
            return Err(("position", "is too far from the scene, or too near the target, for f32"));
        }
        Ok(camera)
    }
}

/// Triangles as cameras see them that stand in the default direction from a point. IEEE 754
/// fixes the results of all operations here.
struct Frame<'a> {
    triangles: &'a [Triangle],
    point: DVec3,
    /// Of half the angles that the picture spans.
    tangents: [f64; 2],
}

impl<'a> Frame<'a> {
    fn new(triangles: &'a [Triangle], point: DVec3, fov: f32, aspect: f64) -> Self {
        let tangent = if fov == DEFAULT_FOV {
            TAN_HALF_FOV
        } else {
            (f64::from(fov).to_radians() / 2.0).tan()
        };
        // A picture that is wider than high is as a square one, so that its width does not
        // change what a scene is.
        Self { triangles, point, tangents: [tangent * aspect.min(1.0), tangent] }
    }

    /// The nearest position from which a camera that looks as from here to `target` sees
    /// all corners.
    fn position(&self, target: DVec3) -> DVec3 {
        // Where it stands decides how it looks at the target, and that where it stands. From
        // far away the first guess is good; wide views need some more.
        let first = self.at(self.distance(axes(TOWARDS_CAMERA)));
        (0..STEPS).fold(first, |from, _| self.at(self.distance(axes(from - target))))
    }

    /// What is in the middle of the picture if it is to show as much on all sides.
    fn centre(&self) -> DVec3 {
        let [right, above, back] = axes(TOWARDS_CAMERA);
        let distance = self.distance([right, above, back]);
        // Within the picture: rounding would put a corner just before the camera anywhere.
        let [tan_x, tan_y] = self.tangents;
        let seen = self.corners().map(|p| {
            let depth = distance - dot(p, back);
            let [x, y] = [dot(p, right) / depth, dot(p, above) / depth];
            [x.clamp(-tan_x, tan_x), y.clamp(-tan_y, tan_y)]
        });
        let spans = seen.map(|point| point.map(|x| [x, x])).reduce(
            || [[f64::INFINITY, f64::NEG_INFINITY]; 2],
            |a, b| std::array::from_fn(|i| [a[i][0].min(b[i][0]), a[i][1].max(b[i][1])]),
        );
        // At most halfway to an edge: so the point itself stays well within the picture.
        let middle = |[low, high]: [f64; 2], tan: f64| {
            ((low + high) / 2.0).clamp(-tan / 2.0, tan / 2.0) * distance
        };
        self.point + right * middle(spans[0], tan_x) + above * middle(spans[1], tan_y)
    }

    fn at(&self, distance: f64) -> DVec3 {
        self.point + axes(TOWARDS_CAMERA)[2] * distance
    }

    /// The corners, from the point.
    fn corners(&self) -> impl ParallelIterator<Item = DVec3> {
        let corners = self.triangles.par_iter().flat_map_iter(|triangle| triangle.positions);
        corners.map(|position| position.as_dvec3() - self.point)
    }

    /// How far from the point a camera with these axes sees all corners.
    fn distance(&self, [right, above, back]: [DVec3; 3]) -> f64 {
        let direction = axes(TOWARDS_CAMERA)[2];
        let [x, y] = [right * MARGIN / self.tangents[0], above * MARGIN / self.tangents[1]];
        // The planes through the camera and the edges of the picture: a corner is in the
        // picture if it is behind all of them.
        let planes = [back + x, back - x, back + y, back - y];
        let furthest = self
            .corners()
            .map(|p| planes.map(|plane| dot(p, plane)))
            .reduce(|| [f64::NEG_INFINITY; 4], |a, b| std::array::from_fn(|i| a[i].max(b[i])));
        let distances = furthest.iter().zip(planes).map(|(far, plane)| far / dot(direction, plane));
        distances.fold(0.0, f64::max)
    }
}

/// To the right, up, and back to a camera in a direction.
fn axes(towards: DVec3) -> [DVec3; 3] {
    let back = towards / dot(towards, towards).sqrt();
    let right = DVec3::new(back.z, 0.0, -back.x);
    let right = right / dot(right, right).sqrt();
    [right, back.cross(right), back]
}

fn dot(a: DVec3, b: DVec3) -> f64 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

/// The direction up: what is given, or +y, or −z where the camera looks along y.
fn up(given: Option<Vec3A>, view: DVec3) -> Result<Vec3A, (&'static str, &'static str)> {
    let view = view.normalize_or_zero();
    let is_across = |up: Vec3A| {
        let sine = view.cross(up.as_dvec3().normalize_or_zero()).length();
        // Without a view, the position is wrong, and its error says so.
        view == DVec3::ZERO || sine >= LEAST_UP_SINE
    };
    let Some(up) = given else {
        return Ok(if is_across(Vec3A::Y) { Vec3A::Y } else { Vec3A::NEG_Z });
    };
    if !up.is_finite() {
        return Err(("up", "must be finite"));
    }
    if up == Vec3A::ZERO || !is_across(up) {
        return Err(("up", "must not be zero or parallel to the view"));
    }
    let squarable = UP_LENGTHS.contains(&length_squared(up).sqrt());
    Ok(if squarable { up } else { up.as_dvec3().normalize().as_vec3a() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangles() -> [Triangle; 2] {
        let triangle = |x: f32| Triangle {
            positions: [[x, 1.0, -2.0], [x, -1.0, 2.0], [-x, 0.5, 1.0]].map(Vec3A::from),
            normals: None,
            uvs: None,
            material: 0,
        };
        [triangle(1.0), triangle(0.25)]
    }

    fn camera(view: View, aspect: f64) -> Result<Camera, (&'static str, &'static str)> {
        let triangles = triangles();
        view.camera(&triangles, &Placement::default(), aspect)
    }

    /// Its numbers enter the fingerprint, so that they must not depend on the machine's
    /// tangents.
    #[test]
    fn the_framing_camera_is_the_same_everywhere() {
        let tangent = (f64::from(DEFAULT_FOV).to_radians() / 2.0).tan();
        assert!((TAN_HALF_FOV - tangent).abs() <= f64::EPSILON, "{tangent}");
        let camera = camera(View::default(), 1.0).expect("a camera");
        assert_eq!(camera.position.to_array(), [2.685_275, 2.237_729_3, 4.475_458_6]);
    }

    /// The picture contains all corners, and one of them is not far from its edge: the margin
    /// is wider in wide views.
    #[test]
    fn framing_cameras_see_everything_and_little_more() {
        for (aspect, fov) in
            [(1.0, 40.0), (0.5, 40.0), (2.0, 40.0), (0.3, 100.0), (1.0, 90.0), (1.0, 120.0)]
        {
            let view = View { vertical_fov: Some(fov), ..View::default() };
            let camera = camera(view, aspect).expect("a camera");
            let forward = (camera.target - camera.position).normalize();
            let right = forward.cross(camera.up).normalize();
            let up = right.cross(forward);
            let tangent = (f64::from(fov) / 2.0).to_radians().tan() as f32;
            let reach = triangles().into_iter().flat_map(|t| t.positions).map(|p| {
                let p = p - camera.position;
                let width = tangent * aspect.min(1.0) as f32;
                let (x, y) = (p.dot(right) / width, p.dot(up) / tangent);
                x.abs().max(y.abs()) / p.dot(forward)
            });
            let largest = reach.fold(0.0, f32::max);
            let least = if fov > 40.0 { 0.4 } else { 0.88 };
            assert!((least..=1.0).contains(&largest), "{aspect} {fov}: {largest}");
        }
    }

    #[test]
    fn cameras_are_completed() {
        // Of the bounding box.
        let middle = Vec3A::ZERO;
        let view = View { position: Some([0.0, 0.0, 9.0]), ..View::default() };
        let from_there = camera(view, 1.0).expect("a camera");
        assert_eq!((from_there.position, from_there.target), (Vec3A::Z * 9.0, middle));
        let above = View { position: Some([0.0, 9.0, 0.0]), target: Some([0.0; 3]), ..view };
        assert_eq!(camera(above, 1.0).expect("a camera").up, Vec3A::NEG_Z);
        let tilted = View { up: Some([1.0, 1.0, 0.0]), ..view };
        assert_eq!(camera(tilted, 1.0).expect("a camera").up, Vec3A::new(1.0, 1.0, 0.0));
        let wider = View { vertical_fov: Some(90.0), ..View::default() };
        let wider = camera(wider.or(view), 1.0).expect("a camera");
        assert_eq!((wider.position, wider.vertical_fov), (Vec3A::Z * 9.0, 90.0));
    }

    #[test]
    fn impossible_cameras_are_refused() {
        let there = View { position: Some([0.0, 0.0, 5.0]), ..View::default() };
        let cases = [
            (View { vertical_fov: Some(180.0), ..there }, "vertical_fov"),
            (View { vertical_fov: Some(f32::NAN), ..there }, "vertical_fov"),
            (View { target: Some([0.0, 0.0, 5.0]), ..there }, "target"),
            (View { target: Some([0.0, f64::NAN, 5.0]), ..there }, "target"),
            (View { position: Some([f64::INFINITY, 0.0, 0.0]), ..there }, "position"),
            (View { position: Some([1e300, 0.0, 0.0]), ..there }, "position"),
            (View { target: Some([0.0, 0.0, 5.000_000_001]), ..there }, "target"),
            (View { up: Some([0.0; 3]), ..there }, "up"),
            (View { up: Some([0.0, 0.0, 1.0]), target: Some([0.0; 3]), ..there }, "up"),
            (View { up: Some([0.0, f32::NAN, 1.0]), ..there }, "up"),
        ];
        for (view, part) in cases {
            assert!(view.has(part) && camera(view, 1.0).is_err_and(|e| e.0 == part), "{view:?}");
        }
    }
}
