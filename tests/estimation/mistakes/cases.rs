//! A folder with one mistake, and what commands have to say of it.

use nalgebra::Rotation3;
use serde_json::Value;
use tau::kinematics::{Pose, zyz};
use tau_testkit::{Ran, Table, Work, list};

pub(crate) const ANGLES: [&str; 3] = ["alpha_rad", "beta_rad", "gamma_rad"];
pub(crate) const AXES: [&str; 3] = ["x_m", "y_m", "z_m"];
/// A Gantry-Tau with poses and both sets of carts.
pub(crate) const GANTRY: &str = "--random --poses 60 --seed 1";
pub(crate) const POSES: &str = "tcp_poses.csv";
pub(crate) const ROBOT: &str = "robot.toml";

/// What is simulated, which file is edited and how, the code of the mistake, and names, numbers and formulas that its
/// sentences hold one after the other.
pub(crate) type Case<'a> = (&'a str, &'a str, fn(&mut Table), &'a str, &'a str);

/// Fails unless check and calibration name the mistake of each row, and nothing else: arguments of a simulation, file, its
/// edit => code, what is told.
macro_rules! all_named {
    ($($simulated:expr, $file:expr, $edit:expr => $code:expr, $told:expr;)*) => {
        $crate::cases::check_all(&[$(($simulated, $file, $edit, $code, $told)),*])
    };
}
pub(crate) use all_named;

/// Where poses are unknown a calibration takes long, and asks what a check does: of several such it does the first.
#[track_caller]
pub(crate) fn check_all(cases: &[Case<'_>]) {
    let of_case = |(index, &(simulated, file, edit, code, told)): (usize, &Case<'_>)| {
        let work = Work::simulated(simulated);
        work.edit(file, edit);
        let is_quick = index == 0 || file == POSES || cfg!(feature = "slow");
        let commands = &COMMANDS[..=usize::from(is_quick)];
        wrong(&work, &model(simulated), [code, file, told], commands)
    };
    let wrong: Vec<String> = cases.iter().enumerate().flat_map(of_case).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

const COMMANDS: [&str; 2] = ["check MEASURED", "calibrate MEASURED --out DIR/out"];

/// Fails unless check and calibration name this mistake alone: its code, file, and what its sentences hold.
#[track_caller]
pub(crate) fn named(work: &Work, model: &str, expected: [&str; 3]) {
    let wrong = wrong(work, model, expected, &COMMANDS);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

fn wrong(
    work: &Work,
    model: &str,
    [code, file, told]: [&str; 3],
    commands: &[&str],
) -> Vec<String> {
    let of_command = |command: &&str| {
        let ran = work.run(&format!("{command} {model} --variant Full -q --json -"));
        let found = mistakes(&ran);
        let is_right = matches!(&found[..], [own] if own.code == code && own.file == file
            && own.told.contains(told) && ran.code == u8::from(own.is_absurd));
        (!is_right).then(|| {
            format!(
                "{model} {code} {file} {told}: {command}: {found:?} {}",
                ran.err
            )
        })
    };
    commands.iter().filter_map(of_command).collect()
}

/// The arguments that name the model that was simulated.
pub(crate) fn model(simulated: &str) -> String {
    let mut words = simulated.split(' ').skip_while(|word| *word != "--model");
    format!("--model {}", words.nth(1).unwrap_or("gantry_tau"))
}

/// A mistake that a command named.
#[derive(Debug)]
pub(crate) struct Named {
    pub(crate) code: String,
    pub(crate) file: String,
    pub(crate) is_absurd: bool,
    /// Quoted names, numbers and formulas of its sentences, in order.
    pub(crate) told: String,
}

impl Named {
    /// Its numbers.
    pub(crate) fn numbers(&self) -> Vec<f64> {
        let words = self.told.split(' ');
        words.filter_map(|word| word.parse().ok()).collect()
    }
}

/// All mistakes in the JSON of a check or a fit.
#[track_caller]
pub(crate) fn mistakes(ran: &Ran) -> Vec<Named> {
    let found: Value = serde_json::from_str(&ran.out).unwrap_or_default();
    let all = [&found["mistakes"], &found["fit"]["mistakes"]];
    let all = all.into_iter().filter_map(Value::as_array).flatten();
    let text = |own: &Value, key: &str| own[key].as_str().unwrap().to_owned();
    all.map(|own| Named {
        code: text(own, "code"),
        file: text(own, "file"),
        is_absurd: own["absurd"] == true,
        told: told(&format!("{} {}", own["what"], own["mend"])),
    })
    .collect()
}

/// Codes of the mistakes that a check names.
#[track_caller]
pub(crate) fn checked(work: &Work, arguments: &str) -> Vec<String> {
    let found = mistakes(&work.run(&format!("check MEASURED {arguments} -q --json -")));
    found.into_iter().map(|own| own.code).collect()
}

/// Quoted names, numbers and formulas of a text, in order.
fn told(text: &str) -> String {
    let words = text.split_whitespace().filter_map(|word| {
        let bare = word.trim_matches(['(', ')', ',', ';', ':', '.', '"', '`']);
        let is_told = word.contains('`') || bare.parse::<f64>().is_ok();
        let formula = word.contains('·').then_some(word);
        formula.or(is_told.then_some(bare))
    });
    words.collect::<Vec<_>>().join(" ")
}

/// Makes the robot file a drawing, which states every tolerance and the noise of a tracker.
pub(crate) fn draw(work: &Work, model: &str) {
    let line = format!("init {model} --out MEASURED/robot.toml --force -q");
    work.run(&line).done();
    work.replace("position_m = \"?\"", "position_m = 1e-5");
    let text = work.read("measured/robot.toml");
    let text = text.replace("rotation_rad = \"?\"", "rotation_rad = 4e-5");
    // Simulated drives are exact.
    let text = text.replace("[drives]", "").replace("noise_m = \"?\"", "");
    work.write("measured/robot.toml", text);
}

/// Multiplies the number behind the last `key = ` of lines of the robot file.
#[track_caller]
pub(crate) fn scale(work: &Work, key: &str, factor: f64, is_meant: impl Fn(&str) -> bool) {
    let text = work.read("measured/robot.toml");
    let scaled = |line: &str| {
        let (before, after) = line.rsplit_once(&format!("{key} = "))?;
        let is_digit = |own: char| own.is_ascii_digit() || ".e-+".contains(own);
        let end = after.find(|own| !is_digit(own)).unwrap_or(after.len());
        let number: f64 = after[..end].parse().ok()?;
        Some(format!(
            "{before}{key} = {:e}{}",
            number * factor,
            &after[end..]
        ))
    };
    let lines = text.lines().map(|line| {
        let meant = Some(line).filter(|line| is_meant(line));
        meant.and_then(scaled).unwrap_or_else(|| line.to_owned()) + "\n"
    });
    let lines: String = lines.collect();
    assert_ne!(lines, text);
    work.write("measured/robot.toml", lines);
}

/// True of lines of a robot file that state a length.
pub(crate) fn is_length(line: &str) -> bool {
    line.contains("_m = ") || line.contains("# m")
}

/// Noise of all measurements in the robot file multiplied.
#[track_caller]
pub(crate) fn scale_noise(work: &Work, factor: f64) {
    for key in ["position_m", "rotation_rad"] {
        scale(work, key, factor, |line| line.starts_with(key));
    }
}

/// Angles of R = Rz(a)·Ry(b)·Rx(c) instead of ZYZ.
pub(crate) fn other_angles(table: &mut Table) {
    table.map_together(ANGLES, |_, angles| {
        let (roll, pitch, yaw) = zyz(*angles).euler_angles();
        *angles = [yaw, pitch, roll];
    });
}

/// Rotations of the measurement frame against the plate.
pub(crate) fn transposed(table: &mut Table) {
    table.map_together(ANGLES, |_, angles| {
        *angles = zyz_angles(zyz(*angles).inverse());
    });
}

/// ZYZ angles of a rotation.
pub(crate) fn zyz_angles(rotation: Rotation3<f64>) -> [f64; 3] {
    let position = [0.0; 3].into();
    Pose { position, rotation }.angles_rad()
}

/// What was measured from a column on so many rows further down, less the rows of which nothing is known then; all rows
/// where it is turned round.
pub(crate) fn shift_down(table: &mut Table, first: &str, by: isize) {
    let columns = table.header[table.index(first)..].to_vec();
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let rows = table.rows.len();
    table.rotate(&columns, by.rem_euclid(rows.cast_signed()) as usize);
    let lost = if by > 0 { 1 } else { rows };
    table.keep(|row| row != lost);
}

/// Exchanges carts 1 and 2.
pub(crate) fn exchange_carts(table: &mut Table) {
    table.map("cart", |_, cart| if cart < 3.0 { 3.0 - cart } else { cart });
}

/// Status and codes of the verdict of a calibration of all measurements.
#[track_caller]
pub(crate) fn verdict(work: &Work, model: &str) -> (String, Vec<String>) {
    let fit = &work.run(&format!(
        "calibrate MEASURED {model} --variant Full --split all --out DIR/out -q --json -"
    ));
    let fit = &fit.printed()["fit"];
    let codes = list(&fit["reasons"]).iter();
    let codes = codes.map(|own| own["code"].as_str().unwrap().to_owned());
    (fit["status"].as_str().unwrap().to_owned(), codes.collect())
}
