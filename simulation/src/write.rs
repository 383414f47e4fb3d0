//! Writing a simulated measurement folder.

use std::ffi::OsString;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use tau_robot::input_error;

use nalgebra::Vector3;
use serde_json::{Map, Value, json};
use tau_codegen::language::model::Place;
use tau_codes::files;
use tau_robot::input_error::InputError;
use tau_robot::measurements::set::{ANGLES, POSITION};
use tau_robot::measurements::{
    CART_POSES, CART_POSITIONS, CartPose, CartPosition, Conditions, DISTANCES, Folder, PlateKind,
    PlateRow, TCP_POSES, Texts,
};
use tau_robot::robot::Robot;
use tau_robot::robot_file::RobotFile;

use super::angles::zyz_angles;
use super::effect::Effect;
use super::folder::{SimulatedFolder, Truth};
use super::forces;
use super::plate;

impl SimulatedFolder {
    /// Names and texts of the folder's files. Numbers are written so that they read back bit for bit;
    /// a set without measurements has no file.
    pub fn texts(&self) -> Vec<(&'static str, String)> {
        let folder = &self.folder;
        let commands = self.shape.command_names();
        let mut files = vec![
            ("robot.toml", self.file.to_toml()),
            ("truth.json", self.truth.to_json()),
        ];
        if !folder.tcp_poses.is_empty() {
            files.push((TCP_POSES, self.tcp_poses()));
        }
        for kind in PlateKind::ALL {
            let rows: Vec<&PlateRow> = folder.rows_of(kind).collect();
            if !rows.is_empty() {
                files.push((kind.file(), plate::rows_text(kind, &rows, &self.shape)));
            }
        }
        if !folder.distances.is_empty() {
            files.push((DISTANCES, plate::distances_text(&folder.distances)));
        }
        if !folder.cart_poses.is_empty() {
            files.push((CART_POSES, cart_poses(&folder.cart_poses)));
        }
        if !folder.cart_positions.is_empty() {
            let text = cart_positions(&folder.cart_positions, &commands);
            files.push((CART_POSITIONS, text));
        }
        files
    }

    /// Columns are the freedoms of the plate: a point has no orientation, and in a plane there are x, y and the angle
    /// about z.
    fn tcp_poses(&self) -> String {
        let rows = &self.folder.tcp_poses;
        let measured = self.shape.pose_names();
        let commands = self.shape.command_names();
        let directions: Vec<String> = (1..=commands.len()).map(|n| format!("dir{n}")).collect();
        let (commands, directions) = (commands.join(","), directions.join(","));
        let columns = if rows.iter().any(|row| row.tensions_n.is_some()) {
            self.shape.force_names()
        } else {
            vec![]
        };
        let names: Vec<&str> = (measured.iter().copied())
            .chain(columns.iter().map(String::as_str))
            .collect();
        let names = names.join(",");
        let mut text = format!("pose,{CONDITIONS},{commands},{directions},{names}\n");
        for row in rows {
            line(&mut text, &[row.pose], |cells| {
                conditions(cells, &row.conditions);
                cells.extend(row.commands_m.iter().map(f64::to_string));
                cells.extend(row.directions.iter().flatten().map(f64::to_string));
                let pose = row.position_m.iter().chain(&row.angles_rad);
                let pose = POSITION.into_iter().chain(ANGLES).zip(pose);
                let pose = pose.filter(|(name, _)| measured.contains(name));
                cells.extend(pose.map(|(_, value)| value.to_string()));
                if let Some(tensions_n) = &row.tensions_n {
                    cells.extend(
                        forces::links(&self.shape).map(|link| tensions_n[link].to_string()),
                    );
                }
            });
        }
        text
    }

    /// Checks that the folder will be taken for measurements of the robot.
    ///
    /// # Errors
    /// Answer of a reader of the folder, by the names that its files would have.
    pub fn check(&self, folder: &Path, robot: &Robot) -> Result<(), InputError> {
        let texts = self.texts();
        let text = |name: &str| {
            let mut files = texts.iter();
            files
                .find(|(file, _)| *file == name)
                .map(|(_, text)| text.as_str())
        };
        let read = Texts::of(text);
        let file = folder.join("robot.toml").display().to_string();
        let file = RobotFile::parse_for(text("robot.toml").unwrap_or_default(), &file, robot);
        Folder::from_texts(&folder.display().to_string(), read, &robot.into())
            .map(|_| ())
            .and(file.map(|_| ()))
            .map_err(|error| {
                error.help("nothing was written: ask for less noise or smaller errors")
            })
    }

    /// Writes the measurement folder: all of it under another name first, so that none is ever there
    /// in part.
    ///
    /// # Errors
    /// There is a file or a folder of that name that is not empty: measurements are never overwritten.
    /// Any other error of the file system.
    pub fn write(&self, folder: &Path) -> Result<(), InputError> {
        let shown = folder.display().to_string();
        let failed = |error: &std::io::Error| input_error!(files::CANNOT_WRITE, &shown; "cannot write the folder: {error}");
        let occupied = match fs::read_dir(folder) {
            Ok(mut entries) => entries.next().is_some(),
            Err(_) => folder.symlink_metadata().is_ok(),
        };
        if occupied {
            return Err(input_error!(files::ALREADY_THERE, &shown;
                "something is there already";
                "name a folder that does not exist or is empty"));
        }
        let Some(name) = folder.file_name() else {
            return Err(input_error!(files::CANNOT_WRITE, &shown; "this does not name a folder"));
        };
        let mut partial_name = OsString::from(".");
        partial_name.push(name);
        partial_name.push(format!(".{}.partial", std::process::id()));
        let partial = Partial(folder.with_file_name(partial_name));
        fs::create_dir_all(&partial.0).map_err(|error| failed(&error))?;
        for (name, text) in self.texts() {
            fs::write(partial.0.join(name), text).map_err(|error| failed(&error))?;
        }
        fs::rename(&partial.0, folder).map_err(|error| failed(&error))
    }
}

/// A folder under its temporary name, removed when this is dropped; once renamed it is no longer there.
struct Partial(PathBuf);

impl Drop for Partial {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

impl Truth {
    /// `{"effects": [{"name", "place", "parameters"}], "status": […], "outliers": […], "links": {…}, "cranks": {…},
    /// "parameters": {…}, "tcp_poses": […], "gross_rows": [{"file", "line"}], "targets", "surfaces", "balls"}`: dimensions
    /// as built, with the names of the robot file, and where the TCP truly stood at each reading of the poses, by their
    /// numbers in the files.
    pub fn to_json(&self) -> String {
        let effects: Vec<Value> = self
            .effects
            .iter()
            .zip(&self.machine.effects)
            .map(|((name, place), effect)| {
                let parameters: Map<String, Value> = effect
                    .parameters
                    .iter()
                    .map(|(name, values)| match values.as_slice() {
                        [value] => (name.clone(), json!(value)),
                        values => (name.clone(), json!(values)),
                    })
                    .collect();
                json!({ "name": name, "place": place, "parameters": parameters })
            })
            .collect();
        let vector = |vector: &Vector3<f64>| <[f64; 3]>::from(*vector);
        let links: Map<String, Value> = (self.links.iter().zip(&self.machine.rods))
            .map(|(name, rod)| {
                let on_cart = rod
                    .track
                    .filter(|&track| self.machine.crank(track).is_none());
                let has_joint = !self.machine.plate.is_point();
                let has_length = rod.transmission.is_none();
                let built = json!({
                    "length_m": has_length.then_some(rod.length_m),
                    "plate_joint_m": has_joint.then(|| vector(&rod.plate_joint_m)),
                    "track_offset_m": vector(&rod.track_offset_m),
                    "track_direction": on_cart.map(|_| vector(&rod.track_direction)),
                    "pull_n": rod.pull_n,
                });
                (name.clone(), built)
            })
            .collect();
        let cranks = self.tracks.iter().zip(&self.machine.cranks);
        let cranks: Map<String, Value> = cranks
            .filter_map(|(name, crank)| {
                let crank = crank.as_ref()?;
                let built =
                    json!({ "centre_m": vector(&crank.centre_m), "axis": vector(&crank.axis) });
                Some((name.clone(), built))
            })
            .collect();
        let parameters: Map<String, Value> = (self.machine.parameters.iter())
            .map(|(name, values)| match values.as_slice() {
                [value] => (name.clone(), json!(value)),
                values => (name.clone(), json!(values)),
            })
            .collect();
        let poses: Vec<Value> = (self.tcp_poses.iter().zip(&self.pose_numbers))
            .map(|(state, number)| {
                json!({
                    "pose": number,
                    "position_m": vector(&state.pose.position_m),
                    "orientation_rad": zyz_angles(&state.pose.rotation),
                })
            })
            .collect();
        let truth = json!({
            "effects": effects,
            "status": self.status,
            "outliers": self.outliers,
            "links": links,
            "cranks": cranks,
            "parameters": parameters,
            "tcp_poses": poses,
            "gross_rows": (self.gross_rows.iter())
                .map(|(file, line)| json!({ "file": file, "line": line }))
                .collect::<Vec<_>>(),
            "targets": (self.objects.targets.iter())
                .map(|(name, place)| (name.clone(), json!({ "position_m": vector(place) })))
                .collect::<Map<_, _>>(),
            "surfaces": (self.objects.surfaces.iter())
                .map(|(name, (normal, offset))| {
                    (name.clone(), json!({ "normal": vector(normal), "offset_m": offset }))
                })
                .collect::<Map<_, _>>(),
            "balls": (self.objects.balls.iter())
                .map(|(name, place)| (name.clone(), json!({ "position_m": vector(place) })))
                .collect::<Map<_, _>>(),
        });
        format!("{truth:#}\n")
    }
}

/// A place as the description and discovery's results write it.
pub(super) fn place(effect: &Effect, robot: &Robot) -> String {
    match effect.place {
        Place::Cart {
            track,
            source: None,
        }
        | Place::Crank(track)
        | Place::CrankCentre(track) => robot.tracks[track].clone(),
        Place::Cart {
            track,
            source: Some(source),
        } => {
            format!("{},{}", robot.tracks[track], robot.tracks[source])
        }
        Place::Link(link) | Place::BaseJoint(link) => robot.links[link].name.clone(),
        Place::AllCarts | Place::AllLinks | Place::AllCranks | Place::AllBaseJoints => {
            "all".to_owned()
        }
        Place::Tcp => "tcp".to_owned(),
    }
}

const CONDITIONS: &str = "time_s,temperature_c";

fn cart_poses(rows: &[CartPose]) -> String {
    let (position, angles) = (POSITION.join(","), ANGLES.join(","));
    let mut text = format!("cart,point,{CONDITIONS},q_m,dir,{position},{angles}\n");
    for row in rows {
        line(&mut text, &[cart(row.track), row.point], |cells| {
            conditions(cells, &row.conditions);
            cells.push(row.command_m.to_string());
            cells.extend(row.direction.iter().map(f64::to_string));
            cells.extend(
                row.position_m
                    .iter()
                    .chain(&row.angles_rad)
                    .map(f64::to_string),
            );
        });
    }
    text
}

fn cart_positions(rows: &[CartPosition], commands: &[String]) -> String {
    let (commands, position) = (commands.join(","), POSITION.join(","));
    let mut text = format!("pose,cart,{CONDITIONS},{commands},dir,{position}\n");
    for row in rows {
        line(&mut text, &[row.pose, cart(row.track)], |cells| {
            conditions(cells, &row.conditions);
            cells.extend(row.commands_m.iter().map(f64::to_string));
            cells.extend(row.direction.iter().map(f64::to_string));
            cells.extend(row.position_m.iter().map(f64::to_string));
        });
    }
    text
}

/// Number of a cart in the file, from 1.
fn cart(track: usize) -> u32 {
    u32::try_from(track + 1).unwrap_or(u32::MAX)
}

fn conditions(cells: &mut Vec<String>, conditions: &Conditions) {
    let both = [conditions.time_s, conditions.temperature_c];
    cells.extend(both.iter().flatten().map(f64::to_string));
}

fn line(text: &mut String, keys: &[u32], fill: impl FnOnce(&mut Vec<String>)) {
    let mut cells: Vec<String> = keys.iter().map(u32::to_string).collect();
    fill(&mut cells);
    // Writing into a string can't fail.
    let _ = writeln!(text, "{}", cells.join(","));
}
