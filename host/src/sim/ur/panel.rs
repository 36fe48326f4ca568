//! What people do at the controller, on the dashboard, at the teach pendant or with the cell's buttons, and what goes wrong.

use super::act::{Act, SafetyInput};
use super::inputs::Fieldbus;
use super::machine::Machine;
use super::robot::{Power, Refusal};
use super::session::{Mishap, Session};
use super::{
    ANNOUNCED_MAX, Controller, INSTALLED, LINE_MAX, LOG_MAX, Options, PROGRAMS, RuntimeState, script, shorten,
};
use crate::link::rtde::TextLevel;

impl Controller {
    /// Starts the loaded program, or goes on with one that is held.
    ///
    /// # Errors
    /// The robot is not ready, or the program cannot be loaded ([`Self::program_fault`]).
    pub fn play(&mut self) -> Result<(), Refusal> {
        if !self.robot.is_ready() {
            self.announce("play refused: the robot is not ready to move".to_owned());
            return Err(Refusal::State);
        }
        if self.runtime == RuntimeState::Paused {
            self.popup_holds = false;
            self.runtime = RuntimeState::Playing;
            return Ok(());
        }
        let text = self.loaded.1.map_or_else(|| self.options.program.clone(), str::to_owned);
        match script::parse(&text) {
            Ok(script) => {
                self.begin_program(Machine::new(script));
                Ok(())
            }
            Err(error) => {
                self.stop_program(&error, &text);
                Err(Refusal::State)
            }
        }
    }

    /// Loads a program by its file name, with any folder before it; the one that runs ends. False: there is none.
    pub fn load(&mut self, path: &str) -> bool {
        let name = path.rsplit('/').next().unwrap_or(path);
        let known = PROGRAMS.into_iter().find(|(known, _)| *known == name).map(|(name, text)| (name, Some(text)));
        let Some(found) = known.or_else(|| (name == INSTALLED).then_some((INSTALLED, None))) else { return false };
        self.end_program();
        self.loaded = found;
        true
    }

    /// The loaded program's name.
    pub const fn program_name(&self) -> &'static str {
        self.loaded.0
    }

    /// Ends the program, if one runs.
    pub fn stop(&mut self) {
        self.end_program();
    }

    /// Holds the program.
    ///
    /// # Errors
    /// None runs.
    pub fn pause(&mut self) -> Result<(), Refusal> {
        match self.runtime {
            RuntimeState::Stopped => Err(Refusal::State),
            RuntimeState::Playing | RuntimeState::Paused => {
                self.runtime = RuntimeState::Paused;
                Ok(())
            }
        }
    }

    /// Gives power to the motors.
    ///
    /// # Errors
    /// An emergency stop, or a fault.
    pub fn power_on(&mut self) -> Result<(), Refusal> {
        self.robot.power_on()
    }

    /// Takes it away; a program that runs ends.
    pub fn power_off(&mut self) {
        self.end_program();
        self.robot.power = Power::Off;
    }

    /// Releases the brakes.
    ///
    /// # Errors
    /// An emergency stop, or a fault.
    pub fn release_brakes(&mut self) -> Result<(), Refusal> {
        self.robot.release_brakes()
    }

    /// Ends a protective stop. The program stays held until somebody plays it.
    ///
    /// # Errors
    /// Younger than [`super::robot::UNLOCK_AFTER`], or another stop.
    pub fn unlock_protective_stop(&mut self) -> Result<(), Refusal> {
        self.robot.unlock()
    }

    /// Starts the safety system again; the motors have no power then, and a button that is down still stops.
    pub fn restart_safety(&mut self) {
        self.end_program();
        self.robot.restart();
    }

    /// The emergency stop button goes down: power goes, the program ends.
    pub fn press_emergency_stop(&mut self) {
        self.set_safety(SafetyInput::RobotEmergency, true);
    }

    fn set_safety(&mut self, input: SafetyInput, on: bool) {
        let mut inputs = self.robot.inputs;
        let (place, name) = match input {
            SafetyInput::RobotEmergency => (&mut inputs.robot_emergency, "emergency stop"),
            SafetyInput::SystemEmergency => (&mut inputs.system_emergency, "system emergency stop"),
            SafetyInput::Safeguard => (&mut inputs.safeguard, "safeguard stop"),
            SafetyInput::Enabling => (&mut inputs.enabling, "stop by the three-position switch"),
            SafetyInput::Reduced => (&mut inputs.reduced, "reduced mode"),
        };
        *place = on;
        self.robot.set_inputs(inputs);
        if !self.robot.may_have_power() {
            self.end_program();
        } else if !self.robot.may_move() && self.runtime == RuntimeState::Playing {
            self.runtime = RuntimeState::Paused;
        }
        if on && !self.robot.may_move() {
            self.announce(name.to_owned());
        } else {
            self.log(&format!("{name} {}", if on { "on" } else { "off" }));
        }
    }

    /// Does what an act says. What belongs to the network, [`Act::Reset`] and the time that [`Act::Restart`] takes, is the
    /// server's to do.
    ///
    /// # Errors
    /// The robot's state does not allow it.
    pub fn act(&mut self, act: &Act) -> Result<(), Refusal> {
        let cycle = self.record.cycle;
        match act {
            Act::ProtectiveStop => self.stop_for(0, "protective stop: on demand"),
            Act::SafetyFault => {
                self.end_program();
                self.robot.fail();
                self.announce("the safety system has failed".to_owned());
            }
            Act::Safety(input, on) => self.set_safety(*input, *on),
            Act::Popup(text) => self.show_popup(text),
            Act::ClosePopup => self.close_popup(),
            Act::Play => return self.play(),
            Act::Pause => return self.pause(),
            Act::Stop => self.stop(),
            Act::PowerOff => self.power_off(),
            Act::RemoteControl(on) => self.desk.remote_control = *on,
            Act::Reset => self.sessions.values_mut().for_each(Session::close),
            Act::Silence(seconds) => self.mute(cycle, *seconds),
            Act::Half(seconds) => self.spoil_next(Mishap::Half { cycles: self.cycles(*seconds) }),
            Act::Corrupt(spoil) => self.spoil_next(Mishap::Spoilt(*spoil)),
            Act::Skip(cycles) => self.skip_until = cycle.saturating_add(*cycles),
            Act::Restart(_) => self.restart(),
            Act::Fieldbus(fieldbus) => self.install(*fieldbus),
            Act::DigitalInput(place, on) => self.cell.set_digital(*place, *on),
            Act::AnalogInput(place, volts) => self.cell.set_analog(*place, *volts),
        }
        Ok(())
    }

    /// Installs a fieldbus, or takes it out.
    pub fn install(&mut self, fieldbus: Fieldbus) {
        self.fieldbus = fieldbus;
        self.exchange.take_for(fieldbus);
    }

    fn cycles(&self, seconds: f64) -> u64 {
        (seconds * f64::from(self.exchange.rate)).round() as u64
    }

    /// RTDE sends nothing from the next cycle on, for so long; to nobody.
    fn mute(&mut self, cycle: u64, seconds: f64) {
        self.silent_until = cycle + 1 + self.cycles(seconds);
        self.sessions.values_mut().for_each(|session| session.silent_until = self.silent_until);
    }

    fn spoil_next(&mut self, mishap: Mishap) {
        self.sessions.values_mut().for_each(|session| session.mishap = Some(mishap));
    }

    /// The controller starts anew: nobody is connected, no power, its time begins at zero. What is installed stays.
    fn restart(&mut self) {
        let options = Options { autoplay: false, powered: false, start_q: self.body.servo.q, ..self.options.clone() };
        // An arm and options that made a controller before make one again; joints that ran out of their range do not.
        let Ok(mut anew) = Self::new(&self.body.arm, options) else { return self.restart_safety() };
        anew.robot.inputs = self.robot.inputs;
        anew.robot.restart();
        (anew.clients, anew.first_second, anew.cell) = (self.clients, 0, self.cell);
        anew.record.timestamp = 0.0;
        anew.install(self.fieldbus);
        anew.limit_protocol(self.exchange.protocol);
        *self = anew;
    }

    /// Shows a message on the teach pendant, instead of the one before.
    pub fn show_popup(&mut self, text: &str) {
        self.popup = Some(shorten(text, LINE_MAX).to_owned());
    }

    /// The message that is shown.
    pub fn popup(&self) -> Option<&str> {
        self.popup.as_deref()
    }

    /// Closes it; a program that waits for that goes on.
    pub fn close_popup(&mut self) {
        self.popup = None;
        if std::mem::take(&mut self.popup_holds) && self.runtime == RuntimeState::Paused && self.robot.is_ready() {
            self.runtime = RuntimeState::Playing;
        }
    }

    /// Adds a line to the log; old ones are dropped.
    pub fn log(&mut self, line: &str) {
        if self.log.len() >= LOG_MAX {
            self.log.pop_front();
        }
        self.log.push_back(shorten(line, LINE_MAX).to_owned());
    }

    /// The log, oldest first: what programs and clients wrote, and why programs did not run.
    pub fn log_lines(&self) -> impl Iterator<Item = &str> {
        self.log.iter().map(String::as_str)
    }

    /// Keeps why the program does not run, and tells every client that has started; where there is none, the first to start.
    pub(super) fn announce(&mut self, fault: String) {
        let fault = shorten(&fault, LINE_MAX).to_owned();
        self.log(&fault);
        self.fault_told = false;
        for session in self.sessions.values_mut().filter(|session| session.is_started()) {
            session.send_text(TextLevel::Error, &fault);
            self.fault_told = true;
        }
        if self.announced.len() >= ANNOUNCED_MAX {
            self.announced.pop_front();
        }
        self.announced.push_back(fault.clone());
        self.fault = Some(fault);
    }

    /// A command of the script ports that is no script; false where it is none.
    pub(super) fn obey(&mut self, command: &str) -> bool {
        // The ports have no answers: what is refused shows in the state.
        let _ = match command {
            "power on" => self.power_on(),
            "power off" => {
                self.power_off();
                Ok(())
            }
            "set robotmode run" => self.release_brakes(),
            // The wait of five seconds is the dashboard's: the tests of the maker's client unlock here at once.
            "set unlock protective stop" => self.robot.unlock_at_once(),
            "stop program" => {
                self.stop();
                Ok(())
            }
            _ => return false,
        };
        true
    }
}
