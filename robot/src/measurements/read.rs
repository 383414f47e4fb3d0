//! From the texts of a measurement folder to its sets.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use super::other_tables::{is_table, other_names, refuse_measurements};
use super::set::{
    ANGLES, ConditionColumns, DIRECTION, DirectionColumns, ForceColumns, POSITION, Set,
    TEMPERATURE, TIME, drop_idle, file_name, read_directions, vector,
};
use super::shape::{Actuator, Shape};
use super::table::Column;
use super::texts::{CART_POSES, CART_POSITIONS, FILES, TCP_POSES, Texts};
use super::{
    CartPose, CartPosition, DISTANCES, Folder, PlateKind, PoseSigmas, TcpPose, plausible,
    read_plate,
};
use tau_codes::{Code, Remark, files, remark};
use tau_model_dsl::nearest;

use crate::input_error::{self, Errors, InputError, Source, both, quoted};

/// Optional columns of sets 2 and 3.
const OPTIONAL: [&str; 3] = [TIME, TEMPERATURE, DIRECTION];

/// Columns of the noise of a row of set 1.
const SIGMAS: [&str; 4] = ["sigma_x_m", "sigma_y_m", "sigma_z_m", "sigma_rotation_rad"];

impl Folder {
    /// That a folder is there, whatever it holds.
    ///
    /// # Errors
    /// It is missing, can't be opened, or is a file.
    pub fn find(path: &Path) -> Result<(), InputError> {
        let wrong = |code: Code, message: &str| {
            InputError::whole(code, path.display().to_string(), message)
        };
        match fs::metadata(path) {
            Ok(metadata) if metadata.is_dir() => Ok(()),
            Ok(_) => Err(wrong(
                files::IS_FILE,
                "this is a file, expected a measurement folder",
            )
            .help(format!("name the folder that holds `{TCP_POSES}`"))),
            Err(error) if error.kind() == ErrorKind::NotFound => Err(wrong(
                files::NO_SUCH_FOLDER,
                &format!("the folder does not exist, expected one that holds `{TCP_POSES}`"),
            )),
            Err(error) => Err(wrong(
                files::CANNOT_READ,
                &format!("cannot open the folder: {error}"),
            )),
        }
    }

    /// Reads a folder. Something must be measured of the plate; without sets 2 and 3 a remark says what they would
    /// have been needed for.
    ///
    /// # Errors
    /// All mistakes of all files: files missing or unreadable, text that is no table of numbers,
    /// quantities in the wrong unit, poses given twice, tables of measurements under other names.
    pub fn read(path: &Path, shape: &Shape) -> Result<Self, InputError> {
        Self::read_noting(path, shape, &[], &mut |_, _| {})
    }

    /// The same of these files alone, if any is named; `note` gets the name and the text of each.
    ///
    /// # Errors
    /// As [`Folder::read`]; a file is named that is not there.
    pub fn read_noting(
        path: &Path,
        shape: &Shape,
        only: &[String],
        note: &mut dyn FnMut(&str, &str),
    ) -> Result<Self, InputError> {
        Self::find(path)?;
        let mut errors = Errors::default();
        let texts: Vec<(&str, Option<String>)> = (FILES.into_iter())
            .map(|file| (file, errors.keep(read_text(&path.join(file)))))
            .collect();
        errors.finish()?;
        let texts = Texts::of(|name| {
            let text = texts.iter().find(|(file, _)| *file == name);
            text.and_then(|(_, text)| text.as_deref())
        });
        let texts = texts.only(only)?;
        let others = refuse_measurements(path, shape);
        if texts.lack_the_plate() {
            return Err(others.err().unwrap_or_else(|| missing_tcp_poses(path)));
        }
        texts.files().for_each(|(file, text)| note(file, text));
        let folder = Self::from_texts(&path.display().to_string(), texts, shape);
        let (mut folder, remarks) = both(folder, others)?;
        folder.remarks.extend(remarks);
        Ok(folder)
    }

    /// Counts time from the first measurement: from the origin of a calendar, what drifts would have drifted
    /// for decades.
    fn start_clock(&mut self) {
        let times: Vec<&mut f64> = (self.tcp_poses.iter_mut().map(|pose| &mut pose.conditions))
            .chain(self.cart_poses.iter_mut().map(|pose| &mut pose.conditions))
            .chain(self.cart_positions.iter_mut().map(|at| &mut at.conditions))
            .chain(self.plate_rows.iter_mut().map(|row| &mut row.conditions))
            .filter_map(|conditions| conditions.time_s.as_mut())
            .collect();
        let first = times
            .iter()
            .map(|time| **time)
            .fold(f64::INFINITY, f64::min);
        for time in times {
            *time -= first;
        }
    }

    /// Reads texts as if they were the files of a folder of that name.
    ///
    /// # Errors
    /// As [`Folder::read`].
    pub fn from_texts(name: &str, texts: Texts<'_>, shape: &Shape) -> Result<Self, InputError> {
        let path = |file: &str| Path::new(name).join(file).display().to_string();
        let mut errors = Errors::default();
        let mut remarks = Vec::new();
        let (tcp_poses, (cart_poses, cart_positions)) = rayon::join(
            || read_set(read_tcp_poses, &path(TCP_POSES), texts.tcp_poses, shape),
            || {
                rayon::join(
                    || read_set(read_cart_poses, &path(CART_POSES), texts.cart_poses, shape),
                    || {
                        read_set(
                            read_cart_positions,
                            &path(CART_POSITIONS),
                            texts.cart_positions,
                            shape,
                        )
                    },
                )
            },
        );
        let tcp_poses = tcp_poses.kept(&mut errors, &mut remarks);
        let cart_poses = cart_poses.kept(&mut errors, &mut remarks);
        // Without tracks there are no carts to measure.
        let lacks_carts = shape.has_carts() && texts.tcp_poses.is_some();
        if lacks_carts && texts.cart_poses.is_none() {
            remarks.push(remark!(files::SET_MISSING;
                "{CART_POSES} (set 2) is missing: piecewise tracks can't be calibrated, and the measured range of the \
                 commands is not known"));
        }
        let cart_positions = cart_positions.kept(&mut errors, &mut remarks);
        if lacks_carts && texts.cart_positions.is_none() {
            remarks.push(remark!(files::SET_MISSING;
                "{CART_POSITIONS} (set 3) is missing: the motion of the carts can't be compared between set 2 and the \
                 TCP poses"));
        }
        let mut files = Vec::new();
        for kind in PlateKind::ALL {
            if let Some(text) = texts.of_kind(kind) {
                let name = path(kind.file());
                let rows = errors.keep(read_plate::read_rows(
                    kind,
                    &name,
                    text,
                    shape,
                    &mut remarks,
                ));
                files.push(read_plate::ReadRows { name, text, rows });
            }
        }
        let distances = texts.distances.map_or(vec![], |text| {
            errors.keep(read_plate::read_distances(
                &path(DISTANCES),
                text,
                &mut remarks,
            ))
        });
        errors.finish()?;
        read_plate::same_commands(&tcp_poses, &files)?;
        let rows = files.iter().flat_map(|file| &file.rows);
        let numbers = rows.map(|(row, _)| row.pose);
        let known = numbers.chain(tcp_poses.iter().map(|pose| pose.pose));
        let known = known.collect();
        read_plate::known_poses(
            &path(DISTANCES),
            texts.distances.unwrap_or_default(),
            &distances,
            &known,
        )?;
        let mut folder = Self {
            name: name.to_owned(),
            tcp_poses,
            has_positions_for_poses: false,
            cart_poses,
            cart_positions,
            plate_rows: (files.into_iter())
                .flat_map(|file| file.rows)
                .map(|(row, _)| row)
                .collect(),
            distances: distances.into_iter().map(|(row, _)| row).collect(),
            fingerprint: texts.fingerprint(),
            remarks,
        };
        folder.start_clock();
        folder.share_tensions();
        Ok(folder)
    }
}

/// Rows of a set, and remarks on them.
struct ReadSet<T> {
    rows: Result<Vec<T>, InputError>,
    remarks: Vec<Remark>,
}

/// Reader of a set: the name of its file, the text, the robot's shape, and where remarks go.
type Reader<T> = fn(&str, &str, &Shape, &mut Vec<Remark>) -> Result<Vec<T>, InputError>;

/// Reads a set that is there; else it has no rows.
fn read_set<T>(read: Reader<T>, name: &str, text: Option<&str>, shape: &Shape) -> ReadSet<T> {
    let mut remarks = Vec::new();
    let rows = text.map_or(Ok(vec![]), |text| read(name, text, shape, &mut remarks));
    ReadSet { rows, remarks }
}

impl<T> ReadSet<T> {
    fn kept(self, errors: &mut Errors, remarks: &mut Vec<Remark>) -> Vec<T> {
        remarks.extend(self.remarks);
        errors.keep(self.rows)
    }
}

/// The text of a file; `None` where there is no such file.
fn read_text(path: &Path) -> Result<Option<String>, InputError> {
    match fs::read(path) {
        Ok(bytes) => input_error::utf8(&path.display().to_string(), bytes).map(Some),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(input_error!(files::CANNOT_READ, path.display().to_string();
            "cannot read the file: {error}")),
    }
}

fn missing_tcp_poses(folder: &Path) -> InputError {
    let names = other_names(folder);
    let error = input_error!(files::NO_SUCH_FILE, folder.join(TCP_POSES).display().to_string();
        "the file does not exist, expected the TCP poses (set 1)");
    let names = || names.iter().map(String::as_str);
    let poses = nearest(TCP_POSES, names()).map(|name| (name, TCP_POSES));
    let tables = names().filter(|name| is_table(name));
    let mut others = tables.filter_map(|name| Some((name, nearest(name, FILES)?)));
    match poses.or_else(|| others.next()) {
        Some((found, meant)) => error.help(format!("found `{found}`, rename it to `{meant}`")),
        None => {
            let names = quoted(PlateKind::ALL.map(PlateKind::file));
            error.help(format!("or other measurements of the plate: {names}"))
        }
    }
}

fn read_tcp_poses(
    name: &str,
    text: &str,
    shape: &Shape,
    remarks: &mut Vec<Remark>,
) -> Result<Vec<TcpPose>, InputError> {
    let optional = [
        &[TIME.to_owned(), TEMPERATURE.to_owned()],
        &shape.direction_names()[..],
    ]
    .concat();
    // Columns of motions that the plate lacks may be there all the same, as trackers write them: they take no part.
    let sigmas = SIGMAS.map(str::to_owned);
    let pose_names = [POSITION, ANGLES].concat();
    let known: Vec<String> = pose_names.iter().map(|&name| name.to_owned()).collect();
    let known = [&optional[..], &sigmas, &known, &shape.force_names()].concat();
    let required = shape.pose_names().into_iter().map(str::to_owned);
    let required: Vec<String> = required.chain(shape.command_names()).collect();
    let mut set = Set::open(Source::new(name, text), ["pose"], &required, &known)?;
    set.refuse_unknown_noise(&sigmas);
    remark(&set, name, &optional, remarks);
    let Set {
        table,
        mut mistakes,
        columns: [pose],
        commands,
        ..
    } = set;
    let commands = commands[shape.pose_names().len()..].to_vec();

    let pose = table.whole_numbers(pose, &mut mistakes);
    let commands = table.numbers_of(&commands, &mut mistakes);
    let mut columns =
        |names: [&str; 3]| names.map(|name| table.numbers_or_zero(name, &mut mistakes));
    let (mut position, mut angles) = (columns(POSITION), columns(ANGLES));
    let of_pose = position.iter_mut().chain(&mut angles);
    let idle = drop_idle(&table, shape, file_name(name), of_pose);
    remarks.extend(idle);
    let conditions = ConditionColumns::read(&table, &mut mistakes);
    let directions = DirectionColumns::read(&table, shape, &mut mistakes);

    let forces = ForceColumns::read(&table, shape, &mut mistakes);
    let sigmas = SIGMAS.map(|name| {
        let index = table.column(name)?;
        let column = table.numbers_or_empty(index, &mut mistakes);
        plausible::deviations(&table, &column, &mut mistakes);
        Some(column)
    });
    let sigma = |axis: usize, row: usize| {
        let value = sigmas[axis].as_ref().map(|column| column.values[row]);
        value.filter(|value| !value.is_nan())
    };

    plausible::commands(&table, &commands, &shape.drives, &mut mistakes);
    plausible::positions(&table, &position, &mut mistakes);
    plausible::angles(&table, &angles, &mut mistakes);
    plausible::one_place_each(&table, &pose, &commands, &mut mistakes);
    plausible::spread(&table, "commands", &commands, &mut mistakes);
    let axes = shape.plate.freedoms_of_tcp().len();
    plausible::spread(&table, "position", &position[..axes], &mut mistakes);
    mistakes.finish()?;

    Ok((0..table.rows())
        .map(|row| TcpPose {
            pose: pose.values[row].unwrap_or_default(),
            line: table.line(row),
            commands_m: commands.iter().map(|column| column.values[row]).collect(),
            position_m: vector(&position, row),
            angles_rad: vector(&angles, row),
            conditions: conditions.at(row),
            directions: directions.at(row),
            tensions_n: forces.at(row),
            sigmas: PoseSigmas {
                position_m: [0, 1, 2].map(|axis| sigma(axis, row)),
                rotation_rad: sigma(3, row),
            },
        })
        .collect())
}

fn read_cart_poses(
    name: &str,
    text: &str,
    shape: &Shape,
    remarks: &mut Vec<Remark>,
) -> Result<Vec<CartPose>, InputError> {
    let [x, y, z] = POSITION;
    let [alpha, beta, gamma] = ANGLES;
    let names = ["cart", "point", "q_m", x, y, z, alpha, beta, gamma];
    let set = open(
        Source::new(name, text),
        names,
        &[],
        &OPTIONAL.map(str::to_owned),
        remarks,
    )?;
    let Set {
        table,
        mut mistakes,
        columns,
        ..
    } = set;
    let [cart, point, q, x, y, z, alpha, beta, gamma] = columns;

    let cart = table.whole_numbers(cart, &mut mistakes);
    let point = table.whole_numbers(point, &mut mistakes);
    let command = [table.numbers(q, &mut mistakes)];
    let position = [x, y, z].map(|index| table.numbers(index, &mut mistakes));
    let angles = [alpha, beta, gamma].map(|index| table.numbers(index, &mut mistakes));
    let conditions = ConditionColumns::read(&table, &mut mistakes);
    let direction = read_directions(&table, DIRECTION, &mut mistakes);

    plausible::carts(&table, &cart, shape, &mut mistakes);
    plausible::commands(&table, &command, &[Actuator::Cart], &mut mistakes);
    plausible::positions(&table, &position, &mut mistakes);
    plausible::angles(&table, &angles, &mut mistakes);
    // A track measured both ways visits each point twice.
    let side = Column {
        index: cart.index,
        values: match &direction {
            Some(column) => column
                .values
                .iter()
                .map(|&sign| Some(u32::from(sign > 0.0)))
                .collect(),
            None => vec![Some(0); table.rows()],
        },
    };
    plausible::distinct_keys(
        &table,
        [&point, &cart, &side],
        &mut mistakes,
        plausible::OWN_NUMBERS,
        |[point, cart, _]| format!("point {point} of cart {cart}"),
    );
    plausible::spread(&table, "command", &command, &mut mistakes);
    plausible::spread(&table, "position", &position, &mut mistakes);
    mistakes.finish()?;

    let poses: Vec<CartPose> = (0..table.rows())
        .map(|row| CartPose {
            track: track(&cart, row),
            point: point.values[row].unwrap_or_default(),
            command_m: command[0].values[row],
            position_m: vector(&position, row),
            angles_rad: vector(&angles, row),
            conditions: conditions.at(row),
            direction: direction.as_ref().map(|column| column.values[row]),
        })
        .collect();
    for unmeasured in (0..shape.tracks())
        .filter(|&track| shape.has_cart(track))
        .filter(|&track| poses.iter().all(|p| p.track != track))
    {
        remarks.push(remark!(files::CART_UNMEASURED;
            "{CART_POSES} (set 2) has no points of cart {}: its track can't be piecewise", unmeasured + 1));
    }
    Ok(poses)
}

fn read_cart_positions(
    name: &str,
    text: &str,
    shape: &Shape,
    remarks: &mut Vec<Remark>,
) -> Result<Vec<CartPosition>, InputError> {
    let [x, y, z] = POSITION;
    let names = ["pose", "cart", x, y, z];
    let optional = OPTIONAL.map(str::to_owned);
    let set = open(
        Source::new(name, text),
        names,
        &shape.command_names(),
        &optional,
        remarks,
    )?;
    let Set {
        table,
        mut mistakes,
        columns: [pose, cart, x, y, z],
        commands,
        ..
    } = set;

    let pose = table.whole_numbers(pose, &mut mistakes);
    let cart = table.whole_numbers(cart, &mut mistakes);
    let commands = table.numbers_of(&commands, &mut mistakes);
    let position = [x, y, z].map(|index| table.numbers(index, &mut mistakes));
    let conditions = ConditionColumns::read(&table, &mut mistakes);
    let direction = read_directions(&table, DIRECTION, &mut mistakes);

    plausible::carts(&table, &cart, shape, &mut mistakes);
    plausible::commands(&table, &commands, &shape.drives, &mut mistakes);
    plausible::positions(&table, &position, &mut mistakes);
    let help = plausible::OWN_NUMBERS;
    plausible::distinct_keys(
        &table,
        [&pose, &cart],
        &mut mistakes,
        help,
        |[pose, cart]| format!("pose {pose} of cart {cart}"),
    );
    plausible::spread(&table, "commands", &commands, &mut mistakes);
    plausible::spread(&table, "position", &position, &mut mistakes);
    mistakes.finish()?;

    Ok((0..table.rows())
        .map(|row| CartPosition {
            pose: pose.values[row].unwrap_or_default(),
            track: track(&cart, row),
            commands_m: commands.iter().map(|column| column.values[row]).collect(),
            position_m: vector(&position, row),
            conditions: conditions.at(row),
            direction: direction.as_ref().map(|column| column.values[row]),
        })
        .collect())
}

/// Finds the columns; remarks on optional columns that are missing and on unknown ones.
fn open<'a, const N: usize>(
    source: Source<'a>,
    names: [&str; N],
    commands: &[String],
    optional: &[String],
    remarks: &mut Vec<Remark>,
) -> Result<Set<'a, N>, InputError> {
    let set = Set::open(source, names, commands, optional)?;
    remark(&set, source.name, optional, remarks);
    Ok(set)
}

/// Remarks on optional columns that are missing and on unknown ones.
fn remark<const N: usize>(
    set: &Set<'_, N>,
    name: &str,
    optional: &[String],
    remarks: &mut Vec<Remark>,
) {
    let absent = set.absent(optional).map(|columns| {
        let file = file_name(name);
        remark!(files::COLUMNS_ABSENT; "{file} has no {columns}: effects that need them can't be seen in this set")
    });
    remarks.extend(absent.into_iter().chain(set.unknown.clone()));
}

/// Index of the track whose cart has the number, from 1, that the file gives.
fn track(cart: &Column<Option<u32>>, row: usize) -> usize {
    cart.values[row].map_or(0, |cart| cart as usize - 1)
}
