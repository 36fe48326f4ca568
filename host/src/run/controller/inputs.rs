//! Whether a controller would give Screed the registers that it writes. RTDE has no way to ask without taking them: so they are
//! asked for by the client of the print itself, on a connection that never starts and is closed at once, which gives them back.

use super::{ControllerError, Line, Place};
use crate::config::Cell;
use crate::link::rtde::{LinkError, Phase, RtdeClient};
use screed_kernel::units::Nanos;
use std::time::{Duration, Instant};

/// How long the negotiation may take.
const PATIENCE: Duration = Duration::from_secs(3);

/// Asks. What stands in the way of the print's client: its error's text, with cause and action.
///
/// # Errors
/// [`ControllerError`] when nobody answers.
pub fn inputs(place: &Place, cell: &Cell) -> Result<Result<(), String>, ControllerError> {
    let link = &cell.link;
    let timeout = u64::try_from(PATIENCE.as_nanos()).unwrap_or(u64::MAX);
    let client =
        RtdeClient::beside(link.recipes.as_ref(), &cell.robot.arm, link.rate_hz, link.register_offset, timeout);
    let mut client = match client {
        Ok(client) => client,
        Err(error) => return Ok(Err(error.to_string())),
    };
    let mut line = Line::connect("RTDE", &place.host, place.rtde)?;
    match agree(&mut client, &mut line)? {
        Ok(()) => Ok(Ok(())),
        Err(error) => Ok(Err(client.explain(&error).to_string())),
    }
}

/// Negotiates up to the start, which is not sent.
fn agree(client: &mut RtdeClient, line: &mut Line) -> Result<Result<(), LinkError>, ControllerError> {
    let began = Instant::now();
    let now = || Nanos(u64::try_from(began.elapsed().as_nanos()).unwrap_or(u64::MAX));
    let mut bytes = [0; 4096];
    while matches!(client.phase(), Phase::Version | Phase::ControllerVersion | Phase::Outputs | Phase::Inputs) {
        loop {
            match client.poll_transmit(now(), &mut bytes) {
                0 => break,
                count => line.send(bytes.get(..count).unwrap_or(&[]))?,
            }
        }
        let heard = match line.receive(&mut bytes, began + PATIENCE)? {
            None => return Err(line.silent(PATIENCE)),
            Some(0) => Err(client.handle_closed()),
            Some(count) => client.handle_bytes(now(), bytes.get(..count).unwrap_or(&[])),
        };
        if heard.is_err() {
            return Ok(heard);
        }
    }
    Ok(Ok(()))
}
