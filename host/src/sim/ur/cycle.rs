//! One control cycle.

use super::body::MotionRefused;
use super::fields::Snapshot;
use super::machine::{Machine, Notice, Surroundings, WatchdogRequest};
use super::messages::Message;
use super::robot::Power;
use super::script::ScriptError;
use super::session::Session;
use super::streams::{Scene, Stream};
use super::{Controller, CycleRecord, RuntimeState, Watchdog, numbers, timestamp};
use crate::link::rtde::program::WatchdogAction;

/// The code of a stop because a joint is not where it should be.
const POSITION_OFF: i32 = 153;

impl Controller {
    /// One control cycle: inputs, watchdogs, program, motion, outputs.
    pub fn step(&mut self) {
        let cycle = self.record.cycle + 1;
        let packages = std::mem::take(&mut self.exchange.packages);
        self.robot.step(1.0 / f64::from(self.exchange.rate));
        let wishes = std::mem::take(&mut self.exchange.wishes);
        self.outputs.apply(&wishes);
        self.speed_slider = wishes.speed_slider.unwrap_or(self.speed_slider);
        self.check_watchdogs(cycle);
        self.run_programs(cycle);
        self.move_joints();
        let mode = self.robot.safety_mode();
        if mode != self.safety_told {
            self.safety_told = mode;
            self.tell(&Message::Safety { mode });
        }
        let first = usize::from(self.options.register_offset);
        let mut registers = [0.0; 6];
        for (register, value) in (first..).zip(&mut registers) {
            *value = self.exchange.inputs.double(register);
        }
        self.record = CycleRecord {
            cycle,
            timestamp: timestamp(self.first_second, cycle, self.exchange.rate),
            received: packages > 0,
            packages,
            seq: self.exchange.inputs.int(first),
            registers,
            target_q: self.body.servo.q,
            actual_q: self.body.servo.q,
            runtime_state: self.runtime,
        };
        let rate = self.exchange.rate;
        self.sessions.values_mut().for_each(|session| session.begin(cycle, rate));
        // Taken out, so that the rest can be looked at meanwhile.
        let mut sessions = std::mem::take(&mut self.sessions);
        if cycle >= self.skip_until && sessions.values().any(Session::is_started) {
            let snapshot = self.snapshot();
            for session in sessions.values_mut() {
                session.send_state(&snapshot, &self.exchange.inputs);
            }
        }
        self.sessions = sessions;
    }

    /// Hands the state after the cycle to a client of 30001 to 30003.
    pub fn feed(&self, stream: &mut Stream) {
        stream.handle_cycle(&Scene {
            snapshot: &self.snapshot(),
            robot: &self.robot,
            runtime: self.runtime,
            arm: &self.body.arm,
            generation: self.options.generation,
            mailbox: &self.mailbox,
        });
    }

    /// Time passes without a cycle: for the robot's power and safety, whose times are a person's, not for its motion.
    pub fn stand_still(&mut self, seconds: f64) {
        self.robot.step(seconds);
    }

    fn check_watchdogs(&mut self, cycle: u64) {
        // Of several that are silent the gravest acts.
        let mut barked: Option<WatchdogRequest> = None;
        for watchdog in &mut self.watchdogs {
            if self.exchange.updated.get(watchdog.request.input) == Some(&true) {
                watchdog.last_update = cycle;
            }
            let silent = (cycle - watchdog.last_update) as f64 / f64::from(self.exchange.rate);
            let graver = barked.as_ref().is_none_or(|other| watchdog.request.action > other.action);
            if silent > watchdog.request.period && graver {
                barked = Some(watchdog.request.clone());
            }
        }
        self.exchange.updated.fill(false);
        let Some(WatchdogRequest { period, action, input }) = barked else { return };
        let (name, program) = (self.exchange.inputs.name(input), self.running.as_deref().unwrap_or(""));
        let told = |done| format!("program {program} {done}: RTDE watchdog: no update of {name} within {period} s");
        match action {
            WatchdogAction::Ignore => {}
            WatchdogAction::Pause if self.runtime == RuntimeState::Playing => {
                let because = told("paused");
                self.runtime = RuntimeState::Paused;
                self.announce(because);
            }
            WatchdogAction::Pause => {}
            WatchdogAction::Stop => {
                let because = told("stopped");
                self.end_program();
                self.announce(because);
            }
        }
    }

    fn run_programs(&mut self, cycle: u64) {
        self.body.expire(cycle);
        if self.runtime == RuntimeState::Playing
            && let Some(mut machine) = self.machine.take()
        {
            match self.run(&mut machine, cycle, true) {
                // The program may have stopped itself.
                Ok(true) if self.runtime != RuntimeState::Stopped => self.machine = Some(machine),
                Ok(_) => self.end_program(),
                Err(error) => self.stop_program(&error, ""),
            }
        }
        for mut machine in std::mem::take(&mut self.secondary) {
            match self.run(&mut machine, cycle, false) {
                Ok(true) => self.secondary.push(machine),
                Ok(false) => {}
                Err(error) => self.announce(format!("secondary program stopped: {error}")),
            }
        }
    }

    fn run(&mut self, machine: &mut Machine, cycle: u64, may_move: bool) -> Result<bool, ScriptError> {
        let (mut watchdogs, mut notices) = (Vec::new(), Vec::new());
        let ran = machine.step(&mut Surroundings {
            cycle,
            cycles_per_second: f64::from(self.exchange.rate),
            inputs: &self.exchange.inputs,
            outputs: &mut self.outputs,
            cell: &self.cell,
            body: &mut self.body,
            may_move,
            watchdogs: &mut watchdogs,
            notices: &mut notices,
        });
        for request in watchdogs {
            self.watchdogs.retain(|watchdog| watchdog.request.input != request.input);
            self.watchdogs.push(Watchdog { request, last_update: cycle });
        }
        for notice in notices {
            match notice {
                Notice::Text(text) => {
                    self.log(&text);
                    self.tell(&Message::Text(text));
                }
                Notice::Popup(popup) => {
                    self.show_popup(&popup.text);
                    if popup.blocking && may_move {
                        self.popup_holds = true;
                        self.runtime = RuntimeState::Paused;
                    }
                    self.tell(&Message::Popup(popup));
                }
                Notice::ProtectiveStop => self.stop_for(0, &MotionRefused::Asked.to_string()),
            }
        }
        ran
    }

    fn move_joints(&mut self) {
        self.body.pace_towards(self.speed_slider);
        if !self.robot.may_move() || self.robot.power != Power::Running {
            self.body.freeze();
        } else if self.runtime != RuntimeState::Playing {
            self.body.hold();
        } else if let Err(refused) = self.body.step() {
            let code = if matches!(refused, MotionRefused::Target(_)) { POSITION_OFF } else { 0 };
            self.stop_for(code, &refused.to_string());
        }
    }

    /// A protective stop: the program is held until a person has unlocked and plays it again.
    pub(super) fn stop_for(&mut self, code: i32, why: &str) {
        self.robot.stop();
        self.tell(&Message::Stop { code, why: why.to_owned() });
        if self.runtime == RuntimeState::Playing {
            self.runtime = RuntimeState::Paused;
        }
        self.announce(why.to_owned());
    }

    /// The program ends: its watchdogs and its movement go with it.
    pub(super) fn end_program(&mut self) {
        if let Some(name) = self.running.take() {
            self.tell(&Message::Program { name, started: false });
        }
        self.machine = None;
        self.watchdogs.clear();
        self.body.abandon_all();
        self.popup_holds = false;
        self.runtime = RuntimeState::Stopped;
    }

    pub(super) fn stop_program(&mut self, error: &ScriptError, text: &str) {
        self.tell(&Message::of_error(error, text));
        self.end_program();
        self.announce(format!("robot program stopped: {error}"));
    }

    /// Puts a message on port 30001.
    pub(super) fn tell(&mut self, message: &Message) {
        // Far below what a u64 holds: a controller runs for years at most.
        self.mailbox.push(message, (self.record.timestamp * 1e6).round() as u64);
    }

    fn snapshot(&self) -> Snapshot<'_> {
        let body = &self.body;
        let playing = self.runtime == RuntimeState::Playing;
        let [standard, configurable, tool] = self.outputs.digital.map(u64::from);
        Snapshot {
            timestamp: self.record.timestamp,
            cycle: self.record.cycle,
            target_q: body.servo.q.0,
            target_qd: body.servo.qd.0,
            target_qdd: body.servo.qdd.0,
            tcp_pose: numbers(&body.base_from_tcp()),
            tcp_speed: body.tool_speed(),
            tcp_offset: numbers(&body.flange_from_tcp),
            target_speed_fraction: self.speed_slider,
            // What the controller's limits take away, beside the slider: nothing here.
            speed_scaling: 1.0,
            runtime_state: self.runtime.code(),
            robot_mode: self.robot.mode(),
            joint_mode: self.robot.joint_mode(),
            // Bit 0: power on; bit 1: program running.
            robot_status_bits: u32::from(self.robot.power != Power::Off) | u32::from(playing) << 1,
            safety_mode: self.robot.safety_mode(),
            safety_status: self.robot.safety_status(),
            safety_status_bits: self.robot.safety_bits(),
            script_line: self.machine.as_ref().map_or(0, Machine::line),
            body,
            cell: self.cell,
            digital_outputs: standard | configurable << 8 | tool << 16,
            outputs: self.outputs.clone(),
        }
    }
}
