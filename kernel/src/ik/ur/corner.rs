//! Where the elbow is stretched or folded and another singularity is near, the pose is reached only with the right value of
//! what the other one leaves free, or leaves to rounding.

use super::{Bend, Geometry, Hand, Plane, Target};
use crate::ik::Side;

/// h (m) from which on its rounding is below that of everything else.
const SHOULDER_NEAR: f64 = 1e-3;
/// What a turn about joint 6 may miss the orientation by (rad), where it is not free but badly known.
const MISS: f64 = 2e-13;
/// Halvings of the way to it.
const HALVINGS: usize = 40;
/// What rounding of ρ² − D² may do to h² (m²). To change it by so much misses the pose by half of it over D.
const ALONG_NOISE: f64 = 1e-14;

impl Geometry {
    /// For a plane and a hand from which the elbow does not reach by so much (m): the nearest from which it does.
    #[cold]
    pub(super) fn corner(
        &self,
        target: &Target,
        (plane, hand, wrist): (&Plane, &Hand, Side),
        seed: &[f64; 6],
        by: f64,
    ) -> Result<(Plane, Hand, Bend), f64> {
        if let Some(hand) = self.turned_to_reach(target, plane, hand) {
            return self.bend_to(target, plane, &hand).map(|bend| (*plane, hand, bend));
        }
        if libm::fabs(plane.along) > SHOULDER_NEAR || plane.free {
            return Err(by);
        }
        // Rounding of h² moves h, and the reach follows it: to the nearest h from which the elbow reaches.
        let at = |along: f64| {
            let plane = self.plane(target, along, seed[0]);
            let hand = plane.hand(target, seed[5]).on(wrist);
            let missing = self.missing(target, &plane, &hand);
            (plane, hand, missing)
        };
        let (side, squared) = (Side::of(plane.along).sign(), plane.along * plane.along);
        let far = side * libm::sqrt(squared + ALONG_NOISE);
        let near = if squared > ALONG_NOISE { side * libm::sqrt(squared - ALONG_NOISE) } else { -far };
        let reaching = [near, far].into_iter().find(|along| at(*along).2 <= 0.0);
        let (mut inside, mut outside) = (reaching.ok_or(by)?, plane.along);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (inside + outside);
            if at(middle).2 <= 0.0 {
                inside = middle;
            } else {
                outside = middle;
            }
        }
        let (plane, hand, _) = at(inside);
        self.bend_to(target, &plane, &hand).map(|bend| (plane, hand, bend))
    }

    /// By how much (m) the elbow does not reach; negative where it does.
    fn missing(&self, target: &Target, plane: &Plane, hand: &Hand) -> f64 {
        let (px, py) = self.goal(target, plane, hand);
        let reach = libm::hypot(px, py);
        let (upper, fore) = (libm::fabs(self.a2), libm::fabs(self.a3));
        (reach - (upper + fore)).max(libm::fabs(upper - fore) - reach)
    }

    /// The hand turned about the nearly common axis of joints 4 and 6 until the elbow is just stretched or just folded, the
    /// shorter way: frame 4's origin moves on a circle of radius d₅ about w, and the law of cosines says where. `None` when
    /// no turn reaches, or only one that misses the pose.
    fn turned_to_reach(&self, target: &Target, plane: &Plane, hand: &Hand) -> Option<Hand> {
        let (wx, wy) = (plane.along, target.wrist.z);
        let away = libm::hypot(wx, wy);
        let (px, py) = self.goal(target, plane, hand);
        let (upper, fore) = (libm::fabs(self.a2), libm::fabs(self.a3));
        let outside = px * px + py * py > upper * upper + fore * fore;
        let reach = if outside { upper + fore } else { libm::fabs(upper - fore) };
        let cosine = (reach * reach - away * away - self.d5 * self.d5) / (2.0 * self.d5 * away);
        // Beyond ±1 no turn reaches, but for rounding.
        if !cosine.is_finite() || libm::fabs(cosine) > 1.0 + 1e-12 {
            return None;
        }
        let (ex, ey) = (wx / away, wy / away);
        // From w to frame 4's origin the direction is (−sin, cos) of θ₂ + θ₃ + θ₄; its angle from w's own, before and after.
        let now = libm::atan2(ex * hand.cosine + ey * hand.sine, ey * hand.cosine - ex * hand.sine);
        let turn = Side::of(now).sign() * libm::acos(cosine.clamp(-1.0, 1.0)) - now;
        if !hand.free && libm::fabs(turn) * hand.margin > MISS {
            return None;
        }
        // Joint 6 turns that direction by cos θ₅ = ±1.
        let theta6 = hand.theta6 + if plane.nz < 0.0 { turn } else { -turn };
        let (s6, c6) = libm::sincos(theta6);
        let turned = plane.hand_with(target, (s6, c6, theta6), hand.margin, hand.free);
        Some(Hand { theta5: hand.theta5, ..turned })
    }
}
