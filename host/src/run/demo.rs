//! `screed demo`: a simulated UR10e, a simulated extruder, `screed-rt` and the host print the published test wall.

use crate::config::Cell;
use crate::failure::{Exit, Failure};
use crate::link::rtde::program::{Program, WatchdogAction};
use crate::model::fim;
use crate::plan::Options as PlanOptions;
use crate::run::children::{self, Process};
use crate::run::print::{self, Print};
use crate::run::session::Wishes;
use crate::run::signal;
use crate::run::summary::Summary;
use crate::run::virtual_time::{self, Virtual};
use crate::sim::line::LineFault;
use screed_fixtures::{QuarterCircle, quarter_circle};
use std::fs;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The demo's model, as it is called in reports.
const MODEL_NAME: &str = "quarter-circle.ifc";

/// What is shown.
#[derive(Clone, Debug)]
pub struct Demo {
    /// How many layers.
    pub layers: usize,
    /// Setpoints a second: 125 or 500.
    pub rate_hz: u32,
    /// Stop after so many seconds of motion.
    pub stop_after: Option<f64>,
    /// Virtual time.
    pub fast: bool,
    /// Spoils one package of the robot (virtual time only).
    pub line_fault: Option<LineFault>,
    /// A robot program instead of the generated one.
    pub program: Option<PathBuf>,
    /// Where to log.
    pub log: Option<PathBuf>,
    /// Where to write what the robot received, a row a cycle.
    pub record: Option<PathBuf>,
    /// Where to write what the extruder was told and did (not in virtual time).
    pub record_extruder: Option<PathBuf>,
    /// Whether no progress is shown.
    pub quiet: bool,
}

impl Demo {
    /// Shows it.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn run(&self) -> Result<Summary, Failure> {
        signal::catch_stop()?;
        let published = QuarterCircle::default();
        let text = quarter_circle(&QuarterCircle { layers: published.layers.max(self.layers), ..published });
        let model = fim::parse(MODEL_NAME, text.as_bytes()).map_err(|e| e.into_failure(MODEL_NAME, text.as_bytes()))?;
        let cell = Cell::demo(self.rate_hz)?;
        let program = match &self.program {
            Some(path) => fs::read_to_string(path).map_err(|error| unreadable(path, &error))?,
            None => program(&cell)?,
        };
        let print = Print {
            cell: &cell,
            model: &model,
            wishes: Wishes {
                plan: PlanOptions { from_layer: 0, layers: Some(self.layers), dry: false },
                stop_after: self.stop_after,
                first_layer_rate: None,
            },
            log: self.log.clone(),
            source: (MODEL_NAME, text.as_bytes()),
            yes: true,
            quiet: self.quiet,
            again: None,
        };
        if !self.fast {
            return self.timed(&print, &program);
        }
        let world = Virtual { program, fault: self.line_fault, record: self.record.clone(), quiet: self.quiet };
        virtual_time::print(&print, world)
    }

    /// Every part in a process of its own.
    fn timed(&self, print: &Print<'_>, program: &str) -> Result<Summary, Failure> {
        let folder = Folder::new()?;
        let program_file = folder.join("robot.script");
        fs::write(&program_file, program).map_err(|error| unreadable(&program_file, &error))?;
        let cell_file = folder.join("cell.toml");
        let cell_text = Cell::demo_text(self.rate_hz)?;
        fs::write(&cell_file, cell_text).map_err(|error| unreadable(&cell_file, &error))?;

        let machines =
            Machines::start(&cell_file, &program_file, self.record.as_deref(), self.record_extruder.as_deref())?;
        let socket = folder.join("rt.sock");
        let mut process = children::screed_rt()?;
        process.arg("--cell").arg(&cell_file).arg("--socket").arg(&socket);
        process.args(machines.arguments()).args(["--exit-when-idle", "60", "--allow-non-rt"]);
        let attached = print::attach(&socket, Some(process))?;
        let summary = print::run(print, attached);
        if summary.is_err() {
            // Whatever was lost, the machines' own watchdogs stop arm and flow; their records shall show it.
            std::thread::sleep(Duration::from_secs(1));
        }
        // In this order: the robot's client has gone, then the simulated machines.
        drop(machines);
        summary
    }
}

/// The simulated robot and extruder, each a process that ends with this.
pub struct Machines {
    _robot: Process,
    _extruder: Process,
    address: String,
    device: String,
}

impl Machines {
    /// Starts both, with records where they are wanted.
    ///
    /// # Errors
    /// [`Failure`] when one does not start.
    pub fn start(
        cell: &Path,
        program: &Path,
        record: Option<&Path>,
        record_extruder: Option<&Path>,
    ) -> Result<Self, Failure> {
        let mut robot = children::screed(["sim", "ur", "--port", "0", "--json"])?;
        robot.args(["--exit-when-idle", "60"]).arg("--program").arg(program).arg("--cell").arg(cell);
        robot.args(record.iter().flat_map(|path| [Path::new("--record"), path]));
        let mut robot = Process::spawn("the simulated robot", robot)?;
        let address = announced(&robot.first_line()?, "listening")?;

        let mut extruder = children::screed(["sim", "extruder", "--json", "--exit-when-idle", "60"])?;
        extruder.args(record_extruder.iter().flat_map(|path| [Path::new("--record"), path]));
        let mut extruder = Process::spawn("the simulated extruder", extruder)?;
        let device = announced(&extruder.first_line()?, "device")?;
        Ok(Self { _robot: robot, _extruder: extruder, address, device })
    }

    /// How `screed-rt` is told of them.
    pub fn arguments(&self) -> [&str; 4] {
        ["--robot", &self.address, "--extruder", &self.device]
    }
}

/// The robot's program for a cell.
///
/// # Errors
/// [`Failure`] when the cell's values make none.
pub fn program(cell: &Cell) -> Result<String, Failure> {
    let program = Program {
        rate_hz: cell.link.rate_hz,
        register_offset: cell.link.register_offset,
        lookahead: cell.link.servoj_lookahead,
        gain: cell.link.servoj_gain,
        watchdog: cell.link.watchdog,
        watchdog_action: WatchdogAction::Stop,
    };
    program.text().map_err(|error| Failure::new(Exit::Input, error.to_string(), "correct [link] in the cell file"))
}

/// A folder of this run's own among the temporary ones, for nobody else, removed at the end.
pub struct Folder(PathBuf);

impl Folder {
    /// Makes it.
    ///
    /// # Errors
    /// [`Failure`] when none can be made.
    pub fn new() -> Result<Self, Failure> {
        // A TMPDIR that is empty counts as not set.
        let base = Some(std::env::temp_dir()).filter(|base| !base.as_os_str().is_empty());
        let base = base.unwrap_or_else(|| PathBuf::from("/tmp"));
        let mut last = None;
        for attempt in 0..100_u32 {
            let path = base.join(format!("screed-{}-{attempt}", std::process::id()));
            match fs::DirBuilder::new().mode(0o700).create(&path) {
                Ok(()) => return Ok(Self(path)),
                Err(error) => last = Some(error),
            }
        }
        let why = last.map_or_else(String::new, |error| error.to_string());
        let message = format!("no folder can be made in {}: {why}", base.display());
        Err(Failure::new(Exit::Failed, message, "set TMPDIR to a folder that can be written"))
    }
}

impl std::ops::Deref for Folder {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn announced(line: &str, key: &str) -> Result<String, Failure> {
    let value = serde_json::from_str::<serde_json::Value>(line).ok();
    value.as_ref().and_then(|value| value.get(key)?.as_str().map(str::to_owned)).ok_or_else(|| {
        let message = format!("expected a line with {key:?} from a simulated machine, found {line:?}");
        Failure::new(Exit::Failed, message, "install programs of one build")
    })
}

fn unreadable(path: &Path, error: &std::io::Error) -> Failure {
    Failure::new(Exit::Failed, format!("{}: {error}", path.display()), "choose a file and folder that can be used")
}
