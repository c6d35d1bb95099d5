//! Sampled directions.

use glam::Vec3A;

/// A direction that light may come from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BsdfSample {
    pub(crate) wi: Vec3A,
    /// f · |cos θi| / pdf.
    pub(crate) weight: Vec3A,
    /// Density of `wi` with respect to solid angle; 0 if `delta`, as there is none.
    pub(crate) pdf: f32,
    /// Whether `wi` is one of a few possible directions, which no other technique finds.
    pub(crate) delta: bool,
}

/// Mirrors directions in the surface.
pub(super) trait Side {
    /// The direction, mirrored if it is not on the side of `wo`.
    fn with_z_towards(self, wo: Vec3A) -> Self;
}

impl Side for Vec3A {
    #[inline]
    fn with_z_towards(self, wo: Vec3A) -> Self {
        Self::new(self.x, self.y, self.z.abs().copysign(wo.z))
    }
}
