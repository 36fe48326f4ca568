//! A batch as bytes for the kernel.

use super::JobError;
use crate::plan::stream::Batch;
use screed_kernel::frame::{self, BatchPart, CODE_MAX, ToKernel, WIRE_MAX};
use screed_kernel::setpoint::{CodeError, Coder, Setpoint};

/// A batch as the frames of its parts.
///
/// # Errors
/// [`JobError::Code`] when a setpoint is not finite or beyond the grid.
pub fn frames(number: u32, batch: &Batch) -> Result<Vec<u8>, JobError> {
    let mut frames = Vec::new();
    let mut coder = Coder::new();
    let mut code = [0; CODE_MAX];
    let mut rest = batch.setpoints.as_slice();
    let mut opens = true;
    while let Some(first) = rest.first() {
        let mut used = 0;
        let mut taken = 0;
        for planned in rest {
            let setpoint = Setpoint { joints: planned.joints, flow: planned.flow, deposit: planned.deposit };
            match coder.encode(&setpoint, code.get_mut(used..).unwrap_or(&mut [])) {
                Ok(length) => (used, taken) = (used + length, taken + 1),
                Err(CodeError::Short) if taken > 0 => break,
                Err(error) => return Err(JobError::Code { seq: planned.seq, error }),
            }
        }
        rest = rest.get(taken..).unwrap_or(&[]);
        let part = BatchPart {
            batch: number,
            first_seq: first.seq,
            opens,
            commits: rest.is_empty(),
            after: batch.after.filter(|_| opens),
            code: code.get(..used).unwrap_or(&[]),
        };
        let mut bytes = [0; WIRE_MAX];
        let length = frame::encode(&ToKernel::Batch(part), &mut bytes).map_err(JobError::Frame)?;
        frames.extend_from_slice(bytes.get(..length).unwrap_or(&[]));
        opens = false;
    }
    Ok(frames)
}
