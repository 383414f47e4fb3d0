//! A folder to work in.

use std::collections::HashMap;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use serde_json::Value;
use tempfile::TempDir;

use crate::{FIXTURES, GANTRY, PROTOTYPE, ROBOTS, Ran, Table};

/// A temporary folder, which holds the measurements in `measured` and goes with its owner.
#[derive(Debug)]
pub struct Work(TempDir);

/// The arguments that name the model of [`Work::described`].
pub const OWN: &str = "--model DIR/own.tau";

/// Files of a folder, each with its place in it.
type Files = Arc<Vec<(PathBuf, Vec<u8>)>>;

impl Work {
    /// An empty folder.
    ///
    /// # Panics
    /// It can't be made.
    pub fn empty() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// A folder with a copy of the measurements that ship.
    pub fn prototype() -> Self {
        Self::copy_of(PROTOTYPE)
    }

    /// A folder with a copy of measurements.
    ///
    /// # Panics
    /// They can't be read.
    #[track_caller]
    pub fn copy_of(measurements: impl AsRef<Path>) -> Self {
        Self::of(&files_below(measurements.as_ref()))
    }

    /// A folder with the measurements that `tau simulate ARGUMENTS` writes. The same arguments are simulated once for
    /// all tests of a process.
    ///
    /// # Panics
    /// The simulation is refused.
    #[track_caller]
    pub fn simulated(arguments: &str) -> Self {
        Self::simulated_with("", arguments)
    }

    /// The same of a machine whose robot file, of which `DIR/robot.toml` is the name in the arguments, is given.
    ///
    /// # Panics
    /// The simulation is refused.
    #[track_caller]
    pub fn simulated_with(robot: &str, arguments: &str) -> Self {
        type Cell = Arc<OnceLock<Files>>;
        static MADE: OnceLock<Mutex<HashMap<[String; 2], Cell>>> = OnceLock::new();
        let key = [robot, arguments].map(str::to_owned);
        let cell = {
            let mut made = MADE
                .get_or_init(Mutex::default)
                .lock()
                .unwrap_or_else(PoisonError::into_inner);
            Arc::clone(made.entry(key).or_default())
        };
        let files = cell.get_or_init(|| {
            let work = Self::empty();
            if !robot.is_empty() {
                work.write("robot.toml", robot);
            }
            work.run(&format!("simulate {arguments} --out MEASURED -q"))
                .done();
            files_below(&work.measured())
        });
        Self::of(files)
    }

    /// A folder with a description, which [`OWN`] names.
    pub fn described(description: &str) -> Self {
        let work = Self::empty();
        work.write("own.tau", description);
        work
    }

    /// Adds the measurements that `tau simulate ARGUMENTS` writes of the machine that is described.
    ///
    /// # Panics
    /// The simulation is refused.
    #[track_caller]
    #[must_use]
    pub fn with_measured(self, arguments: &str) -> Self {
        self.run(&format!("simulate {OWN} {arguments} --out MEASURED -q"))
            .done();
        self
    }

    fn of(files: &Files) -> Self {
        let work = Self::empty();
        for (place, bytes) in files.iter() {
            let path = work.measured().join(place);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
        }
        work
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// The measurements in it.
    pub fn measured(&self) -> PathBuf {
        self.0.path().join("measured")
    }

    /// Runs `tau LINE` in this process. Words are separated by spaces; `MEASURED` is the folder of the measurements and
    /// `DIR` the folder that holds it, `PROTOTYPE`, `GANTRY`, `ROBOTS` and `FIXTURES` are what the repository holds.
    pub fn run(&self, line: &str) -> Ran {
        let folder = self.path().display().to_string();
        let names = [
            ("MEASURED", "DIR/measured"),
            ("DIR", folder.as_str()),
            ("PROTOTYPE", PROTOTYPE),
            ("GANTRY", GANTRY),
            ("ROBOTS", ROBOTS),
            ("FIXTURES", FIXTURES),
        ];
        let word = |word: &str| {
            let replaced = |word: String, (name, path): &(&str, &str)| word.replace(name, path);
            OsString::from(names.iter().fold(word.to_owned(), replaced))
        };
        let words = std::iter::once("tau").chain(line.split_whitespace());
        let (mut out, mut err) = (Vec::new(), Vec::new());
        let code = tau_cli::run(words.map(word), &mut out, &mut err);
        let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
        Ran {
            code,
            out: text(out),
            err: text(err).replace(&folder, "DIR"),
        }
    }

    /// What a command line prints for programs.
    #[track_caller]
    pub fn json(&self, line: &str) -> Value {
        self.run(&format!("{line} --json -")).json()
    }

    /// Calibrates the measurements with some arguments into `DIR/out`, and says what was found.
    #[track_caller]
    pub fn calibrated(&self, arguments: &str) -> Value {
        self.json(&format!("calibrate MEASURED {arguments} --out DIR/out -q"))
    }

    /// Judges the measurements, with some arguments, by the robot file that [`Self::calibrated`] wrote.
    #[track_caller]
    pub fn evaluated(&self, arguments: &str) -> Value {
        self.json(&format!(
            "evaluate MEASURED {arguments} --robot DIR/out/robot.toml -q"
        ))
    }

    /// Searches the measurements, with some arguments, and writes what is found into `DIR/found`.
    #[track_caller]
    pub fn discovered(&self, arguments: &str) -> Value {
        self.json(&format!("discover MEASURED {arguments} --out DIR/found -q"))
    }

    /// The machine that a simulation measured.
    ///
    /// # Panics
    /// The measurements are not of a simulation.
    #[track_caller]
    pub fn truth(&self) -> Value {
        serde_json::from_str(&self.read("measured/truth.json")).unwrap()
    }

    /// Changes a table of the measurements.
    #[track_caller]
    pub fn edit(&self, file: &str, change: impl FnOnce(&mut Table)) {
        let mut table = self.table(&format!("measured/{file}"));
        change(&mut table);
        self.write(&format!("measured/{file}"), table.to_string());
    }

    /// A table of the folder.
    #[track_caller]
    pub fn table(&self, file: &str) -> Table {
        Table::parse(&self.read(file))
    }

    /// Replaces every occurrence of a text in the robot file of the measurements.
    ///
    /// # Panics
    /// There is none.
    #[track_caller]
    pub fn replace(&self, old: &str, new: &str) {
        let text = self.read("measured/robot.toml");
        assert!(text.contains(old), "`{old}` in {text}");
        self.write("measured/robot.toml", text.replace(old, new));
    }

    /// Adds lines to the robot file of the measurements.
    #[track_caller]
    pub fn state(&self, lines: &str) {
        let stated = self.read("measured/robot.toml");
        self.write("measured/robot.toml", format!("{stated}\n{lines}\n"));
    }

    /// The text of a file of the folder.
    #[track_caller]
    pub fn read(&self, file: &str) -> String {
        let path = self.path().join(file);
        fs::read_to_string(&path).unwrap_or_else(|error| panic!("{file}: {error}"))
    }

    /// Writes a file of the folder, and folders that it needs.
    ///
    /// # Panics
    /// It can't be written.
    pub fn write(&self, file: &str, content: impl AsRef<[u8]>) -> &Self {
        let path = self.path().join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
        self
    }

    /// Removes a file of the folder.
    ///
    /// # Panics
    /// There is none.
    #[track_caller]
    pub fn remove(&self, file: &str) -> &Self {
        fs::remove_file(self.path().join(file)).unwrap();
        self
    }

    /// Names of what a folder in this one holds, in order; those of this one for an empty name.
    ///
    /// # Panics
    /// There is none.
    #[track_caller]
    pub fn listing(&self, folder: &str) -> Vec<String> {
        let entries = fs::read_dir(self.path().join(folder)).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }
}

fn files_below(folder: &Path) -> Files {
    let mut files = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in
            fs::read_dir(&next).unwrap_or_else(|error| panic!("{}: {error}", next.display()))
        {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                let place = path.strip_prefix(folder).unwrap().to_owned();
                files.push((place, fs::read(&path).unwrap()));
            }
        }
    }
    Arc::new(files)
}
