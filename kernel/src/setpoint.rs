//! One sample of the motion, and its predictive code on the wire.

use crate::units::JointPos;

/// Joint positions travel on a grid of 2⁻³⁶ rad (1.46e-11), a power of two: every grid value is an exact `f64`, and second
/// differences over 2 ms carry less than 2e-5 rad/s² of rounding.
pub const JOINT_QUANTUM: f64 = 1.0 / (1_u64 << 36) as f64;

/// Flow travels on a grid of 1e-12 m³/s (one nanolitre a second).
pub const FLOW_QUANTUM: f64 = 1e-12;

/// Largest grid index accepted, 2⁴⁶: 1,024 rad or m, for axes that turn often and for long gantries. Nothing below it can
/// overflow in the predictor, and every index is an exact `f64`.
const GRID_MAX: i64 = 1 << 46;

/// One sample: where the joints are to be and what flows, at one period after the sample before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setpoint<const N: usize> {
    /// Joint target (rad or m), on the grid of [`JOINT_QUANTUM`].
    pub joints: JointPos<N>,
    /// Extrusion rate at 100 % of the path clock (m³/s), on the grid of [`FLOW_QUANTUM`].
    pub flow: f64,
    /// Whether material is being laid (as opposed to approach, travel, lift).
    pub deposit: bool,
}

impl<const N: usize> Setpoint<N> {
    /// All zero: what unused slots of the ring hold.
    pub const ZERO: Self = Self { joints: JointPos::ZERO, flow: 0.0, deposit: false };
}

/// The nearest grid value to a joint position (rad or m).
pub fn joint_on_grid(position: f64) -> f64 {
    libm::rint(position / JOINT_QUANTUM) * JOINT_QUANTUM
}

/// The nearest grid value to a flow (m³/s).
pub fn flow_on_grid(flow: f64) -> f64 {
    libm::rint(flow / FLOW_QUANTUM) * FLOW_QUANTUM
}

/// Why a setpoint cannot be put into code, or bytes are no setpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CodeError {
    /// The bytes ended inside a setpoint, or the room for them did.
    Short,
    /// A number was longer than 64 bits or beyond the grid's range, or a flag byte was not known.
    Range,
}

/// Predicts each setpoint from those before it and codes only the difference: joints by the parabola through the last
/// three, flow by the line through the last two. One coder a batch: the first setpoint is its key.
///
/// Code of a setpoint: a flag byte (bit 0: deposit), then for each joint and then for the flow the zigzag LEB128 varint of
/// grid index minus prediction.
#[derive(Clone, Copy, Debug)]
pub struct Coder<const N: usize> {
    joints: [[i64; 3]; N],
    flow: [i64; 2],
    seen: u8,
}

impl<const N: usize> Coder<N> {
    /// Before a batch's first setpoint.
    pub const fn new() -> Self {
        Self { joints: [[0; 3]; N], flow: [0; 2], seen: 0 }
    }

    /// Writes one setpoint to the front of `out`, returns the bytes used. On error the coder is unchanged.
    ///
    /// # Errors
    /// [`CodeError::Short`] when `out` is too small, [`CodeError::Range`] when a value is not finite or beyond the grid.
    pub fn encode(&mut self, setpoint: &Setpoint<N>, out: &mut [u8]) -> Result<usize, CodeError> {
        let mut next = *self;
        *out.first_mut().ok_or(CodeError::Short)? = u8::from(setpoint.deposit);
        let mut used = 1;
        for (history, &position) in next.joints.iter_mut().zip(&setpoint.joints.0) {
            let index = index(position, JOINT_QUANTUM)?;
            let residual = index.wrapping_sub(predict(history, self.seen));
            put_varint(residual, out, &mut used)?;
            *history = [index, history[0], history[1]];
        }
        let index = index(setpoint.flow, FLOW_QUANTUM)?;
        let residual = index.wrapping_sub(predict_line(&next.flow, self.seen));
        put_varint(residual, out, &mut used)?;
        next.flow = [index, next.flow[0]];
        next.seen = self.seen.saturating_add(1).min(3);
        *self = next;
        Ok(used)
    }

    /// Reads one setpoint from the front of `bytes`, returns it and the bytes used.
    ///
    /// # Errors
    /// [`CodeError::Short`] when the bytes end inside it, [`CodeError::Range`] when they are no code.
    pub fn decode(&mut self, bytes: &[u8]) -> Result<(Setpoint<N>, usize), CodeError> {
        let mut setpoint = Setpoint::ZERO;
        setpoint.deposit = match bytes.first() {
            Some(0) => false,
            Some(1) => true,
            Some(_) => return Err(CodeError::Range),
            None => return Err(CodeError::Short),
        };
        let mut used = 1;
        for (history, position) in self.joints.iter_mut().zip(&mut setpoint.joints.0) {
            #[cfg(test)]
            crate::steps::count();
            let index = on_grid(predict(history, self.seen), take_varint(bytes, &mut used)?)?;
            *history = [index, history[0], history[1]];
            *position = index as f64 * JOINT_QUANTUM;
        }
        let index = on_grid(predict_line(&self.flow, self.seen), take_varint(bytes, &mut used)?)?;
        self.flow = [index, self.flow[0]];
        setpoint.flow = index as f64 * FLOW_QUANTUM;
        self.seen = self.seen.saturating_add(1).min(3);
        Ok((setpoint, used))
    }
}

impl<const N: usize> Default for Coder<N> {
    fn default() -> Self {
        Self::new()
    }
}

fn index(value: f64, quantum: f64) -> Result<i64, CodeError> {
    let index = libm::rint(value / quantum);
    if libm::fabs(index) <= GRID_MAX as f64 { Ok(index as i64) } else { Err(CodeError::Range) }
}

fn on_grid(prediction: i64, residual: i64) -> Result<i64, CodeError> {
    let index = prediction.checked_add(residual).ok_or(CodeError::Range)?;
    if (-GRID_MAX..=GRID_MAX).contains(&index) { Ok(index) } else { Err(CodeError::Range) }
}

/// The parabola through the last three samples, newest first; a line or a constant while there are fewer. Nothing wraps: no
/// index is above [`GRID_MAX`].
fn predict(history: &[i64; 3], seen: u8) -> i64 {
    let [newest, middle, oldest] = *history;
    match seen {
        0 => 0,
        1 => newest,
        2 => newest.wrapping_mul(2).wrapping_sub(middle),
        _ => newest.wrapping_sub(middle).wrapping_mul(3).wrapping_add(oldest),
    }
}

fn predict_line(history: &[i64; 2], seen: u8) -> i64 {
    let [newest, older] = *history;
    match seen {
        0 => 0,
        1 => newest,
        _ => newest.wrapping_mul(2).wrapping_sub(older),
    }
}

/// Longest code of 64 bits, seven to a byte.
const VARINT_MAX: u32 = 10;

/// Writes a varint at `used` and moves that behind it.
fn put_varint(value: i64, out: &mut [u8], used: &mut usize) -> Result<(), CodeError> {
    let mut rest = ((value << 1) ^ (value >> 63)) as u64;
    for _ in 0..VARINT_MAX {
        let slot = out.get_mut(*used).ok_or(CodeError::Short)?;
        *used += 1;
        let low = (rest & 0x7f) as u8;
        rest >>= 7;
        if rest == 0 {
            *slot = low;
            return Ok(());
        }
        *slot = low | 0x80;
    }
    Err(CodeError::Range)
}

/// Reads the varint at `used` and moves that behind it.
fn take_varint(bytes: &[u8], used: &mut usize) -> Result<i64, CodeError> {
    let mut value = 0_u64;
    for place in 0..VARINT_MAX {
        #[cfg(test)]
        crate::steps::count();
        let byte = *bytes.get(*used).ok_or(CodeError::Short)?;
        *used += 1;
        let low = u64::from(byte & 0x7f);
        if place == VARINT_MAX - 1 && low > 1 {
            return Err(CodeError::Range);
        }
        value |= low << (7 * place);
        if byte & 0x80 == 0 {
            return Ok(((value >> 1) as i64) ^ -((value & 1) as i64));
        }
    }
    Err(CodeError::Range)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(k: usize) -> Setpoint<6> {
        let t = k as f64 * 0.008;
        let joints = core::array::from_fn(|j| joint_on_grid(0.4 * libm::sin(0.3 * t * (j + 1) as f64) - j as f64));
        Setpoint {
            joints: JointPos(joints),
            flow: flow_on_grid(2e-5 * (1.0 - libm::exp(-t))),
            deposit: k.is_multiple_of(3),
        }
    }

    #[test]
    fn what_is_on_the_grid_comes_back_bit_for_bit() {
        let (mut encoder, mut decoder) = (Coder::<6>::new(), Coder::<6>::new());
        let mut total = 0;
        for k in 0..1000 {
            let mut bytes = [0; 80];
            let used = encoder.encode(&wave(k), &mut bytes).unwrap();
            let (back, taken) = decoder.decode(&bytes[..used]).unwrap();
            assert_eq!((back, taken), (wave(k), used));
            total += used;
        }
        // 20.9 bytes on this wave; the bound of the wire format is 24 on a printed path.
        assert!(total < 24 * 1000, "{total}");
    }

    #[test]
    fn the_grid_reaches_a_thousand_turns_and_metres_and_no_prediction_overflows() {
        let far = GRID_MAX as f64 * JOINT_QUANTUM;
        assert_eq!(far, 1024.0);
        let at = |position: f64| Setpoint::<9> { joints: JointPos([position; 9]), flow: 0.0, deposit: false };
        let (mut encoder, mut decoder) = (Coder::new(), Coder::new());
        // A prediction is at most 7 of these: 3·(1 + 1) + 1.
        for k in 0..64_u32 {
            let setpoint = at(if 0b1101_0010_0110_1110 >> (k % 16) & 1 == 0 { far } else { -far });
            let mut bytes = [0; 100];
            let used = encoder.encode(&setpoint, &mut bytes).unwrap();
            assert_eq!(decoder.decode(&bytes[..used]), Ok((setpoint, used)));
        }
        let beyond = at(far + JOINT_QUANTUM);
        assert_eq!(encoder.encode(&beyond, &mut [0; 100]), Err(CodeError::Range));
        assert_eq!(Coder::new().encode(&at(-far - JOINT_QUANTUM), &mut [0; 100]), Err(CodeError::Range));
    }

    #[test]
    fn bytes_that_are_no_code_are_refused() {
        let mut decoder = Coder::<6>::new();
        assert_eq!(decoder.decode(&[]), Err(CodeError::Short));
        assert_eq!(decoder.decode(&[2]), Err(CodeError::Range));
        assert_eq!(decoder.decode(&[0, 0x80]), Err(CodeError::Short));
        assert_eq!(decoder.decode(&[0xff; 12]), Err(CodeError::Range));
        let mut far = [0_u8; 20];
        far[1..11].copy_from_slice(&[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1]);
        assert_eq!(decoder.decode(&far), Err(CodeError::Range));
        let endless = Setpoint { joints: JointPos([f64::NAN; 6]), ..Setpoint::ZERO };
        assert_eq!(Coder::new().encode(&endless, &mut [0; 80]), Err(CodeError::Range));
    }
}
