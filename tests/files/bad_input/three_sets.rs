//! Tables of the plate's poses and of the carts.

use tau::measurements::Split;
use tau_testkit::{Table, Work};

use super::*;

/// Case, a stretch of `tcp_poses.csv`, what stands in its place, and the answer.
const OF_TCP_POSES: &str = r#"
misspelt column                 | q2_m      | q2m         | T214:1
column in another unit          | alpha_rad | alpha_deg   | T214:1
capital letters                 | x_m,y_m   | X_M,Y_M     | T214:1 T214:1
duplicate column                | y_m       | x_m         | T214:1 T215:1
semicolons                      | *,        | ;           | T211:1
tabs                            | *,        | \t          | T211:1
text in a number                | -0.199    | abc         | T217:3
NaN                             | -0.199    | NaN         | T217:3
infinity                        | -0.199    | -inf        | T217:3
overflow                        | -0.199    | 1e999       | T217:3
empty field                     | -0.199    |             | T217:3
quoted decimal comma            | -0.199    | "-0,199"    | T217:3
typographic minus               | -0.199    | −0.199      | T217:3
decimal commas                  | *.        | ,           | T213:2
fractional pose                 | \n2,      | \n2.5,      | T218:3
negative pose                   | \n2,      | \n-2,       | T218:3
duplicate pose                  | \n3,      | \n1,        | T226:4
direction                       | -1,-1     | -1,0        | T223:3
kelvin                          | 20.1      | 293.2       | T223:3
row too short                   | ,-1.545   |             | T213:3
row too long                    | -1.545    | -1.545,7    | T213:3
one angle in degrees            | 1.482     | 84.912      | T222:4
one position in millimetres     | -1.703    | -1703       | T221:4
"#;

/// Case, file, columns that are multiplied, by how much, and the answer.
const UNITS: &str = "
degrees                       | tcp_poses.csv      | alpha_rad beta_rad gamma_rad | 57.29577951308232 | T222:2 T222:2 T222:2
one column in degrees         | tcp_poses.csv      | beta_rad                     | 57.29577951308232 | T222:2
positions in millimetres      | tcp_poses.csv      | x_m y_m z_m                  | 1000              | T221:4
commands in millimetres       | tcp_poses.csv      | q1_m q2_m                    | 1000              | T221:3
cart poses in millimetres     | cart_poses.csv     | x_m y_m z_m                  | 1000              | T221:2
cart commands in millimetres  | cart_poses.csv     | q_m                          | 1000              | T221:5
cart angles in degrees        | cart_poses.csv     | alpha_rad beta_rad gamma_rad | 57.29577951308232 | T222:2 T222:2 T222:2
cart positions in millimetres | cart_positions.csv | x_m y_m z_m                  | 1000              | T221:2
all commands equal            | tcp_poses.csv      | q1_m q2_m                    | 0                 | T227:1
small machine                 | tcp_poses.csv      | x_m y_m z_m                  | 0.01              | -
long tracks                   | tcp_poses.csv      | q1_m q2_m                    | 20                | -
angles beyond half a turn     | tcp_poses.csv      | alpha_rad                    | 4                 | -
";

/// Case, file, a stretch of it, what stands in its place, and the answer.
const OF_CARTS: &str = r"
cart number        | cart_poses.csv     | \n2,1 | \n3,1 | T225:4
cart zero          | cart_positions.csv | 1,1,  | 1,0,  | T225:2
duplicate point    | cart_poses.csv     | 2,2,0 | 2,1,0 | T226:5
duplicate position | cart_positions.csv | 1,2   | 1,1   | T226:3
";

fn text(file: &str) -> &'static str {
    SETS.iter().find(|(own, _)| *own == file).unwrap().1
}

#[test]
fn tables_of_the_plate_and_of_carts() {
    let mut answers = Answers::default();
    let mut answer = |case: &str, file: &str, contents: &str, expected: &str| {
        let work = with(file, contents);
        answers.read(case, [file, expected], &work, read(&work));
    };
    for [case, old, new, expected] in cases(OF_TCP_POSES) {
        let new = new.replace("\\t", "\t");
        answer(&case, TCP, &replaced(TCP_POSES, &old, &new), &expected);
    }
    for [case, file, old, new, expected] in cases(OF_CARTS) {
        answer(&case, &file, &replaced(text(&file), &old, &new), &expected);
    }
    for [case, file, columns, factor, expected] in cases(UNITS) {
        let mut table = Table::parse(text(&file));
        let columns: Vec<&str> = columns.split(' ').collect();
        table.scale(&columns, factor.parse().unwrap());
        answer(&case, &file, &table.to_string(), &expected);
    }
    let (header, rows) = TCP_POSES.split_once('\n').unwrap();
    answer("no header", TCP, rows, "T212:1");
    answer("wrong header", TCP, "a,b,c\n1,2,3\n", "T214:1");
    answer("set 2 for set 1", TCP, CART_POSES, "T214:1 T214:1 T214:1");
    let german = TCP_POSES.replace(',', ";").replace('.', ",");
    answer("semicolons and decimal commas", TCP, &german, "T211:1");
    let still = rows.lines().next().unwrap().split_once(',').unwrap().1;
    let still = format!("{header}\n1,{still}\n2,{still}\n3,{still}\n");
    answer("all poses equal", TCP, &still, "T227:1 T227:1");
    let mut table = Table::parse(TCP_POSES);
    table.shift("x_m", 80.0);
    let far = table.to_string();
    answer("a tracker eighty metres off", TCP, &far, "-");
    insta::assert_snapshot!(answers.shown());
}

#[test]
fn harmless_variations_are_accepted() {
    let plain = read(&folder_of(&SETS)).unwrap();
    let mut reversed = Table::parse(TCP_POSES);
    reversed.header.reverse();
    reversed.rows.iter_mut().for_each(|row| row.reverse());
    for variation in [
        TCP_POSES.replace('\n', "\r\n"),
        TCP_POSES.replace('\n', "\r"),
        format!("\u{feff}{TCP_POSES}"),
        format!("{TCP_POSES}\n \n\n"),
        TCP_POSES.trim_end().to_owned(),
        TCP_POSES.replace(',', " ,\t"),
        TCP_POSES
            .replace("-1.903", "\"-1.903\"")
            .replace("x_m", "\"x_m\""),
        TCP_POSES.replace("\n1,", "\n1.0000000e+00,"),
        reversed.to_string(),
    ] {
        let found = read(&with(TCP, &variation)).unwrap();
        assert_eq!(found.tcp_poses, plain.tcp_poses, "{variation}");
    }
}

#[test]
fn missing_sets_and_columns_are_remarked() {
    let mut table = Table::parse(&TCP_POSES.replace("dir2", "note"));
    table.append_column("\"a, b\"", |_| "1");
    table.append_column("", |_| "");
    let work = folder_of(&[(TCP, table.to_string().as_str())]);
    let read = read(&work).unwrap();
    assert_eq!(read.tcp_poses[0].directions, None);
    let remarks: Vec<String> = read.remarks.iter().map(ToString::to_string).collect();
    insta::assert_snapshot!(remarks.join("\n"));
}

#[test]
fn splits() {
    let mut answers = Answers::default();
    let work = Work::empty();
    for text in [
        "",
        "altrnate",
        "first",
        "first:x",
        "first:0",
        "fraction:1.5",
        "fraction:0.5:x",
    ] {
        let split = text.parse::<Split>();
        answers.read(&format!("`{text}`"), ["--split", "T261:1"], &work, split);
    }
    insta::assert_snapshot!(answers.shown());
}
