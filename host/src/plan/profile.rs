//! When the tool is where: speed over arc length for one move, from rest to rest.
//!
//! A move is a row of [`Stretch`]es. Each is cruised at one speed, the whole move's cruise speed or less where curvature
//! asks for it, and joined to its neighbours by [`Ramp`]s; the tool rests wherever a stretch ends in a tangent break. All
//! ramps begin and end without acceleration. Source of the shape: Slepicka, Helou, Borrmann, "RTDE robot control
//! integration for Fabrication Information Modeling", 3.1.2: constant speed over the layer with hyperbolic-tangent ramps.

mod brake;
mod ramp;

pub use brake::Brake;
pub use ramp::Ramp;

/// Share of the acceleration limit that turning may take while cruising; √(1 − 0.8²) = 0.6 of it is then left to ramps.
const TURNING_SHARE: f64 = 0.8;
/// Cruise speeds tried for the shortest time, each 0.8 of the one before.
const TRIALS: i32 = 24;
/// How exactly a time is met: to this (s), and to this share of it where rounding over hours is more.
const TIME_TOLERANCE: [f64; 2] = [1e-10, 1e-13];
/// How exactly a length is used up by ramps, as a share of it; what is left is cruised.
const LENGTH_TOLERANCE: f64 = 1e-13;

/// Limits along a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathLimits {
    /// Highest speed (m/s).
    pub velocity_max: f64,
    /// Highest magnitude of the whole acceleration vector (m/s²).
    pub acceleration_max: f64,
    /// Highest rate of change of the acceleration along the path (m/s³).
    pub jerk_max: f64,
}

/// A part of a path that one cruise speed suits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// Arc length (m).
    pub length: f64,
    /// Greatest curvature (1/m).
    pub curvature_max: f64,
    /// Whether the tool has to rest at its end: there the tangent breaks, or the move is over.
    pub rest_after: bool,
}

/// Where the tool is at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Arc length from the start of the move (m).
    pub s: f64,
    /// Speed (m/s).
    pub velocity: f64,
    /// Acceleration along the path (m/s²); exactly 0 while cruising or at rest.
    pub acceleration: f64,
}

/// One ramp, or one cruise between ramps.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Phase {
    /// When and where it begins, from the start of the move (s, m).
    start: [f64; 2],
    duration: f64,
    distance: f64,
    shape: Shape,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    Cruise { velocity: f64 },
    Rise(Ramp),
    Fall(Ramp),
}

/// Arc length over time for one move.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    phases: Vec<Phase>,
    /// Ends of the runs between rests (time s, arc length m), the last one being the end of the move.
    rests: Vec<[f64; 2]>,
    pace: Pace,
    limited: Limited,
}

/// What a profile is made with besides its limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// The speed sought on every stretch (m/s).
    pub cruise: f64,
    /// Softness of the ramps, see [`Ramp::new`]: 1 for the paper's.
    pub softness: f64,
}

/// What kept stretches from the cruise speed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Limited {
    /// Stretches whose curvature asks for a lower speed.
    pub by_curvature: usize,
    /// Stretches too short to reach their speed.
    pub by_length: usize,
}

/// The wanted time is too short.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TooShort {
    /// The shortest time within the limits (s).
    pub shortest: f64,
}

/// One stretch as planned: its speeds and the limit that its ramps keep.
#[derive(Clone, Copy)]
struct Leg {
    length: f64,
    enter: f64,
    peak: f64,
    leave: f64,
    acceleration_max: f64,
    rest_after: bool,
}

impl Profile {
    /// The quickest profile within the limits. Lengths and limits must be positive and finite, curvatures not negative.
    pub fn quickest(stretches: &[Stretch], limits: &PathLimits) -> Self {
        let (_, pace) = quickest_of(stretches, limits, 0.0);
        Self::at(stretches, limits, pace)
    }

    /// The profile that takes `wanted` seconds: with the paper's ramps by way of its cruise speed, and where these are too
    /// slow even at the highest speed, by way of their softness.
    ///
    /// # Errors
    /// [`TooShort`] when the limits do not allow it.
    pub fn lasting(stretches: &[Stretch], limits: &PathLimits, wanted: f64) -> Result<Self, TooShort> {
        let late = |pace| duration(&legs(stretches, limits, pace), limits, pace) - wanted;
        let tolerance = TIME_TOLERANCE[0].max(TIME_TOLERANCE[1] * wanted);
        // Time grows without bound as the speed falls, so that one speed in between takes exactly the time wanted.
        let soft = |cruise| Pace { cruise, softness: 1.0 };
        if let Some(quick) = trial_speeds(limits).find(|&cruise| late(soft(cruise)) <= 0.0) {
            let cruise = last_within(quick, 0.0, tolerance, |cruise| late(soft(cruise)));
            return Ok(Self::at(stretches, limits, soft(cruise)));
        }
        let (shortest, Pace { cruise, .. }) = quickest_of(stretches, limits, 0.0);
        if shortest.is_nan() || shortest > wanted || wanted.is_nan() {
            return Err(TooShort { shortest });
        }
        let pace = |softness| Pace { cruise, softness };
        let softness = last_within(0.0, 1.0, tolerance, |softness| late(pace(softness)));
        Ok(Self::at(stretches, limits, pace(softness)))
    }

    fn at(stretches: &[Stretch], limits: &PathLimits, pace: Pace) -> Self {
        let speed = pace.cruise;
        let legs = legs(stretches, limits, pace);
        let mut profile = Self { phases: Vec::new(), rests: Vec::new(), pace, limited: Limited::default() };
        let (mut time, mut s) = (0.0, 0.0);
        for (leg, stretch) in legs.iter().zip(stretches) {
            let end = s + leg.length;
            let [rise, fall] = leg.ramps(limits.jerk_max, pace.softness);
            let cruise = (leg.length - rise.distance() - fall.distance()).max(0.0);
            let cruising = Shape::Cruise { velocity: leg.peak };
            for (duration, distance, shape) in [
                (rise.duration(), rise.distance(), Shape::Rise(rise)),
                (cruise / leg.peak, cruise, cruising),
                (fall.duration(), fall.distance(), Shape::Fall(fall)),
            ] {
                if duration > 0.0 {
                    profile.phases.push(Phase { start: [time, s], duration, distance, shape });
                    time += duration;
                    s += distance;
                }
            }
            // Rounding must not add up along the path.
            s = end;
            if leg.rest_after {
                profile.rests.push([time, s]);
            }
            let allowed = speed_allowed(stretch, limits, speed);
            profile.limited.by_curvature += usize::from(allowed < speed);
            profile.limited.by_length += usize::from(leg.peak < allowed);
        }
        profile
    }

    /// How long the move takes (s).
    pub fn duration(&self) -> f64 {
        self.rests.last().map_or(0.0, |rest| rest[0])
    }

    /// The cruise speed sought, and the softness of the ramps.
    pub fn pace(&self) -> Pace {
        self.pace
    }

    /// The highest speed reached (m/s).
    pub fn velocity_max(&self) -> f64 {
        self.phases.iter().fold(0.0, |max, phase| phase.state_at(phase.start[0]).velocity.max(max))
    }

    /// What kept stretches from the cruise speed.
    pub fn limited(&self) -> Limited {
        self.limited
    }

    /// How often the tool comes to rest, the end included.
    pub fn rest_count(&self) -> usize {
        self.rests.len()
    }

    /// The state at `t` seconds from the start; before the start at rest there, after the end at rest there.
    pub fn state_at(&self, t: f64) -> State {
        let at_rest = |s| State { s, velocity: 0.0, acceleration: 0.0 };
        let index = self.phases.partition_point(|phase| phase.start[0] <= t);
        let Some(phase) = index.checked_sub(1).and_then(|index| self.phases.get(index)) else { return at_rest(0.0) };
        match self.rests.last() {
            Some(&[end, s]) if t >= end => at_rest(s),
            _ => phase.state_at(t),
        }
    }

    /// The next rest at or after `t` (time s, arc length m): the end of the run under way.
    pub fn next_rest(&self, t: f64) -> [f64; 2] {
        let index = self.rests.partition_point(|rest| rest[0] < t).min(self.rests.len().saturating_sub(1));
        self.rests.get(index).copied().unwrap_or([0.0; 2])
    }

    /// Whether the tool slows down to its next rest without a cruise before it.
    pub fn comes_to_rest(&self, t: f64) -> bool {
        let index = self.phases.partition_point(|phase| phase.start[0] <= t);
        let phase = index.checked_sub(1).and_then(|index| self.phases.get(index));
        phase.is_some_and(|phase| matches!(phase.shape, Shape::Fall(ramp) if ramp.slow() == 0.0))
    }
}

impl Phase {
    fn state_at(&self, t: f64) -> State {
        let [start, s] = self.start;
        let since = (t - start).min(self.duration);
        match &self.shape {
            Shape::Cruise { velocity } => {
                State { s: s + (velocity * since).min(self.distance), velocity: *velocity, acceleration: 0.0 }
            }
            Shape::Rise(ramp) => {
                let ramp = ramp.state_at(since);
                State { s: s + ramp.s, ..ramp }
            }
            Shape::Fall(ramp) => {
                let ramp = ramp.state_at(self.duration - since);
                State { s: s + (self.distance - ramp.s), velocity: ramp.velocity, acceleration: -ramp.acceleration }
            }
        }
    }
}

impl Leg {
    fn ramps(&self, jerk_max: f64, softness: f64) -> [Ramp; 2] {
        [self.enter, self.leave].map(|slow| Ramp::new(slow, self.peak, self.acceleration_max, jerk_max, softness))
    }
}

/// The highest speed, and lower ones: a lower one may take less time where a curve's share of the acceleration leaves
/// little for its ramps.
fn trial_speeds(limits: &PathLimits) -> impl Iterator<Item = f64> {
    let velocity_max = limits.velocity_max;
    (0..TRIALS).map(move |i| velocity_max * libm::pow(0.8, f64::from(i)))
}

/// The shortest time (s) at this softness, and its pace.
fn quickest_of(stretches: &[Stretch], limits: &PathLimits, softness: f64) -> (f64, Pace) {
    let paces = trial_speeds(limits).map(|cruise| Pace { cruise, softness });
    let timed = paces.map(|pace| (duration(&legs(stretches, limits, pace), limits, pace), pace));
    let highest = Pace { cruise: limits.velocity_max, softness };
    timed.fold((f64::INFINITY, highest), |best, trial| if trial.0 < best.0 { trial } else { best })
}

/// From `within`, where the excess is not positive, towards `beyond`, where it is: a value at which it is not positive, and
/// more than −`tolerance` unless neighbouring numbers straddle that. Regula falsi with the Illinois weights (Dowell and
/// Jarratt, BIT 11, 1971), every third step a halving, so that no shape of the excess makes it crawl.
fn last_within(within: f64, beyond: f64, tolerance: f64, excess: impl Fn(f64) -> f64) -> f64 {
    let (mut inside, mut outside) = ((within, excess(within)), (beyond, excess(beyond)));
    let mut best = inside;
    let mut last_inside = None;
    for step in 1..200 {
        if best.1 >= -tolerance {
            break;
        }
        let secant = (inside.0 * outside.1 - outside.0 * inside.1) / (outside.1 - inside.1);
        let between = (secant - inside.0) * (secant - outside.0) < 0.0;
        let x = if between && step % 3 != 0 { secant } else { 0.5 * (inside.0 + outside.0) };
        if x == inside.0 || x == outside.0 {
            break;
        }
        let found = excess(x);
        let is_inside = found <= 0.0;
        // The end that stays a second time counts half, so that the next secant falls beyond the root.
        let stays = if last_inside == Some(is_inside) { 0.5 } else { 1.0 };
        last_inside = Some(is_inside);
        if is_inside {
            (inside, best) = ((x, found), (x, found));
            outside.1 *= stays;
        } else {
            outside = (x, found);
            inside.1 *= stays;
        }
    }
    best.0
}

/// The highest value in [low, high] whose distance is within `length`; distances grow with the value, that of `low` fits.
fn highest(low: f64, high: f64, length: f64, distance: impl Fn(f64) -> f64) -> f64 {
    if high <= low || distance(high) <= length {
        return high.max(low);
    }
    last_within(low, high, LENGTH_TOLERANCE * length, |value| distance(value) - length)
}

/// The speed at which turning takes no more than its share of the acceleration, or `speed`.
fn speed_allowed(stretch: &Stretch, limits: &PathLimits, speed: f64) -> f64 {
    let speed = speed.min(limits.velocity_max);
    if stretch.curvature_max > 0.0 {
        speed.min((TURNING_SHARE * limits.acceleration_max / stretch.curvature_max).sqrt())
    } else {
        speed
    }
}

/// Speeds at the stretches' ends by one pass forward and one back (what can be reached from before, and from behind), then
/// each stretch's peak.
fn legs(stretches: &[Stretch], limits: &PathLimits, pace: Pace) -> Vec<Leg> {
    let ramp_distance = |leg: &Leg, slow: f64, fast: f64| {
        Ramp::new(slow, fast, leg.acceleration_max, limits.jerk_max, pace.softness).distance()
    };
    let reached = |leg: &Leg, low: f64, high: f64| highest(low, high, leg.length, |fast| ramp_distance(leg, low, fast));
    let mut legs: Vec<Leg> = stretches
        .iter()
        .enumerate()
        .map(|(index, stretch)| {
            let peak = speed_allowed(stretch, limits, pace.cruise);
            let turning = peak * peak * stretch.curvature_max;
            let left = limits.acceleration_max * limits.acceleration_max - turning * turning;
            let rest_after = stretch.rest_after || index + 1 == stretches.len();
            let length = stretch.length;
            Leg { length, enter: 0.0, peak, leave: 0.0, acceleration_max: left.max(0.0).sqrt(), rest_after }
        })
        .collect();
    let mut speed = 0.0;
    for i in 0..legs.len() {
        let next_peak = legs.get(i + 1).map_or(0.0, |next| next.peak);
        let leg = &mut legs[i];
        leg.enter = speed;
        let wanted = if leg.rest_after { 0.0 } else { leg.peak.min(next_peak) };
        leg.leave = reached(leg, leg.enter, wanted).min(wanted);
        speed = leg.leave;
    }
    let mut speed = 0.0;
    for leg in legs.iter_mut().rev() {
        leg.leave = leg.leave.min(speed);
        leg.enter = reached(leg, leg.leave, leg.enter).min(leg.enter);
        speed = leg.enter;
        let ends = |peak| ramp_distance(leg, leg.enter, peak) + ramp_distance(leg, leg.leave, peak);
        leg.peak = highest(leg.enter.max(leg.leave), leg.peak, leg.length, ends);
    }
    legs
}

fn duration(legs: &[Leg], limits: &PathLimits, pace: Pace) -> f64 {
    let leg_duration = |leg: &Leg| {
        let [rise, fall] = leg.ramps(limits.jerk_max, pace.softness);
        rise.duration() + fall.duration() + (leg.length - rise.distance() - fall.distance()).max(0.0) / leg.peak
    };
    legs.iter().map(leg_duration).sum()
}

#[cfg(test)]
mod tests;
