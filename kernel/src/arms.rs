//! The catalogue of robots: [`ur::ALL`], [`SPHERICAL_WRISTS`], [`gantry::CONTOUR_CRAFTER`] and [`crane::CRANE_NJ130`].

pub mod abb;
pub mod comau;
pub mod crane;
pub mod gantry;
pub mod kuka;
pub mod opw;
pub mod ur;

use crate::arm::Arm;

/// Every arm of the catalogue with a spherical wrist and a base that stands.
pub const SPHERICAL_WRISTS: [Arm<6>; 6] =
    [kuka::KR120_R2500, kuka::KR210_R2700, abb::IRB140, abb::IRB6700_200, comau::NJ130, comau::NS12];
