//! A client that only reads: one recipe, every package of it, and never an input.

use super::connection::Connection;
use super::error::{Explained, LinkError};
use super::file::{Recipe, RecipeFile};
use super::recipe::{Field, Recipes};
use super::wire::{Protocol, TextMessage};
use super::{ControllerVersion, Phase};
use screed_kernel::units::Nanos;

/// The client.
#[derive(Clone, Debug)]
pub struct RtdeReader {
    connection: Connection,
    /// Fields of the recipe; one more may stand behind them.
    wanted: usize,
}

impl RtdeReader {
    /// For a fresh connection, whose first request waits in [`Self::poll_transmit`]. `rate_hz` is asked for in protocol 2.
    ///
    /// # Errors
    /// [`LinkError::RecipeTooLong`].
    pub fn new(file: &RecipeFile, recipe: &Recipe, rate_hz: u32, timeout_ns: u64) -> Result<Self, LinkError> {
        let recipes = Recipes::reading(recipe, file)?;
        Ok(Self { connection: Connection::new(recipes, rate_hz, timeout_ns), wanted: recipe.fields.len() })
    }

    /// The same for outputs of the guide's table by their names.
    ///
    /// # Errors
    /// [`LinkError::RecipeTooLong`].
    pub fn of(names: &[&str], rate_hz: u32, timeout_ns: u64) -> Result<Self, LinkError> {
        let recipes = Recipes::of(names)?;
        let wanted = recipes.outputs.len();
        Ok(Self { connection: Connection::new(recipes, rate_hz, timeout_ns), wanted })
    }

    /// Takes bytes, split anywhere; each data package that is complete is handed on: the values of [`Self::fields`].
    ///
    /// # Errors
    /// Every [`LinkError`] of a received package; the same one again from then on.
    pub fn handle_bytes(
        &mut self,
        now: Nanos,
        bytes: &[u8],
        mut on_values: impl FnMut(&[u8]),
    ) -> Result<(), LinkError> {
        self.connection.handle_bytes(now, bytes, |_, values| {
            on_values(values);
            Ok(())
        })
    }

    /// What each package holds: the recipe's fields, and behind them the time stamp where the recipe has none.
    pub fn fields(&self) -> &[Field] {
        &self.connection.recipes().outputs
    }

    /// How many of them are the recipe's own.
    pub const fn wanted(&self) -> usize {
        self.wanted
    }

    /// The oldest text of the controller that was not polled yet, and how many were lost before it.
    pub fn poll_text(&mut self) -> Option<(TextMessage, u32)> {
        self.connection.poll_text()
    }

    /// Moves bytes for the controller into `out`; how many. Call it until it gives 0.
    pub fn poll_transmit(&mut self, now: Nanos, out: &mut [u8]) -> usize {
        self.connection.poll_transmit(now, out)
    }

    /// When [`Self::handle_timeout`] wants to be called.
    pub fn poll_timeout(&self) -> Option<Nanos> {
        self.connection.poll_timeout()
    }

    /// Checks whether the controller has been silent for too long.
    ///
    /// # Errors
    /// [`LinkError::Silent`], [`LinkError::Incomplete`]; the error of a failed connection, again.
    pub fn handle_timeout(&mut self, now: Nanos) -> Result<(), LinkError> {
        self.connection.handle_timeout(now)
    }

    /// The connection was closed by the controller; gives the error to report.
    pub fn handle_closed(&mut self) -> LinkError {
        self.connection.handle_closed()
    }

    /// Asks for no more data: [`Phase::Paused`] once that is confirmed.
    ///
    /// # Errors
    /// [`LinkError::NotRunning`]; the error of a failed connection, again.
    pub fn pause(&mut self) -> Result<(), LinkError> {
        self.connection.pause()
    }

    /// What the client is doing.
    pub const fn phase(&self) -> Phase {
        self.connection.agreed().phase
    }

    /// The controller's software, once it has said so.
    pub const fn controller(&self) -> Option<ControllerVersion> {
        self.connection.agreed().controller
    }

    /// The protocol in force, or being asked for.
    pub const fn protocol(&self) -> Protocol {
        self.connection.agreed().protocol
    }

    /// An error with its place in the recipe file, where it is about a field of it.
    pub const fn explain<'a>(&'a self, error: &'a LinkError) -> Explained<'a> {
        self.connection.explain(error)
    }
}
