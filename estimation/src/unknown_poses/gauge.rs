//! Gauge freedoms: combinations that measurements leave open, in words of the machine.

use crate::numerics::order::{largest_first, smallest_first};
use crate::numerics::singular;
use nalgebra::{DMatrix, DVector, Vector3};
use tau_kinematics::Machine;
use tau_robot::robot::Owner;

use super::elimination::Reduced;
use super::objects::Object;
use super::quantity::across;

/// A direction of which the data know less than this share of what they know best is open: between the rounding of
/// squares (1e-16 to 1e-12) and the weakest that measurements of a machine determine (1e-6).
const OPEN: f64 = 1e-9;
/// Share of a motion outside the open directions up to which it is one of them: rounding in the null space, below the
/// millimetre in a hundred metres that would make it another.
const NAMED: f64 = 1e-5;
/// Share of a motion within the directions not yet named from which on it names another one; what others have named
/// leaves rounding alone.
const INDEPENDENT: f64 = 1e-3;

/// A motion or change of the machine that no residual sees.
#[derive(Debug, Clone, PartialEq)]
pub struct Freedom {
    /// True for a motion that no more measurements of these kinds would settle; otherwise there are too few of them, or
    /// they are too much alike.
    pub is_motion: bool,
    /// In words, such as `rotation of the machine about z`.
    pub words: String,
    /// True for the scale of the whole machine.
    pub is_scale: bool,
    /// Change of each shared unknown, in units of its tolerance, of length one.
    pub(super) direction: DVector<f64>,
}

/// Motions that are named of those that are open together: more tell a reader nothing.
const NAMED_TOGETHER: usize = 4;

/// A motion with its name.
struct Motion {
    words: String,
    is_scale: bool,
    /// True of a parameter alone, which is open only together with motions.
    is_parameter: bool,
    change: DVector<f64>,
}

/// Shared unknowns as motions change them.
pub(super) struct Shared<'a> {
    pub(super) machine: &'a Machine,
    /// Indices in the variant of the first ones.
    pub(super) used: &'a [usize],
    /// The others.
    pub(super) objects: &'a [Object],
    /// Values of all of them.
    pub(super) values: &'a [f64],
}

/// Beginning of the words for what is no motion.
const OF_PARAMETERS: &str = "a combination of";
/// Quantities that motions change by themselves.
const DIMENSIONS: [&str; 4] = ["length", "plate_joint", "track_offset", "track_direction"];
const AXES: [&str; 3] = ["x", "y", "z"];

impl Shared<'_> {
    /// Changes of all unknowns by what is done to points fixed in space and on the plate, to directions in space, to
    /// lengths and to the lengths of driven links.
    fn change(&self, rule: &Rule) -> DVector<f64> {
        let mut change = DVector::zeros(self.values.len());
        let variant = &self.machine.variant;
        for (place, &index) in self.used.iter().enumerate() {
            let parameter = &variant.parameters[index];
            let vector = |quantity: &str| {
                Vector3::from_fn(|axis, _| {
                    let found = variant.parameter(parameter.owner, quantity, Some(axis));
                    found.map_or(0.0, |index| self.machine.values[index])
                })
            };
            if matches!(
                parameter.owner,
                Owner::Effect(_) | Owner::Frame(_) | Owner::Target { .. }
            ) {
                continue;
            }
            let axis = parameter.component.unwrap_or(0);
            change[place] = match parameter.quantity.as_str() {
                "length" => {
                    rule.length(self.machine.values[index], self.is_driven(parameter.owner))
                }
                "plate_joint" => (rule.on_plate)(vector("plate_joint"))[axis],
                "track_offset" => (rule.in_space)(vector("track_offset"))[axis],
                "track_direction" => (rule.travel)(vector("track_direction"))[axis],
                _ => 0.0,
            };
        }
        for object in self.objects {
            let at = self.used.len() + object.first;
            let own = &self.values[at..at + 3];
            let place = Vector3::from_column_slice(own);
            let moved = match object.section {
                "targets" => (rule.on_plate)(place),
                "balls" => (rule.in_space)(place),
                _ => {
                    let [u, v] = across(&object.normal);
                    let normal = (object.normal + u * own[0] + v * own[1]).normalize();
                    let turned = (rule.direction)(normal);
                    let point = normal * own[2];
                    let offset = normal.dot(&(rule.in_space)(point)) + turned.dot(&point);
                    Vector3::new(u.dot(&turned), v.dot(&turned), offset)
                }
            };
            change.rows_mut(at, 3).copy_from(&moved);
        }
        change
    }

    fn is_driven(&self, owner: Owner) -> bool {
        let links = &self.machine.robot.links;
        matches!(owner, Owner::Link(link) if links[link].actuated_by.is_some())
    }

    fn motions(&self) -> Vec<Motion> {
        let mut motions = vec![];
        let still = |_: Vector3<f64>| Vector3::zeros();
        for (axis, name) in AXES.iter().enumerate() {
            let unit = Vector3::ith(axis, 1.0);
            motions.push(Motion {
                words: format!("position of the machine along {name}"),
                is_scale: false,
                is_parameter: false,
                change: self.change(&Rule {
                    in_space: &|_| unit,
                    direction: &still,
                    travel: &still,
                    on_plate: &still,
                    longer: Longer::No,
                }),
            });
        }
        for (axis, name) in AXES.iter().enumerate() {
            let unit = Vector3::ith(axis, 1.0);
            motions.push(Motion {
                words: format!("rotation of the machine about {name}"),
                is_scale: false,
                is_parameter: false,
                change: self.change(&Rule {
                    in_space: &|point| unit.cross(&point),
                    direction: &|way| unit.cross(&way),
                    travel: &|way| unit.cross(&way),
                    on_plate: &still,
                    longer: Longer::No,
                }),
            });
        }
        for (axis, name) in AXES.iter().enumerate() {
            let unit = Vector3::ith(axis, 1.0);
            motions.push(Motion {
                words: format!("position of the TCP on the plate along its {name}"),
                is_scale: false,
                is_parameter: false,
                change: self.change(&Rule {
                    in_space: &still,
                    direction: &still,
                    travel: &still,
                    on_plate: &|_| unit,
                    longer: Longer::No,
                }),
            });
        }
        for (axis, name) in AXES.iter().enumerate() {
            let unit = Vector3::ith(axis, 1.0);
            motions.push(Motion {
                words: format!("orientation of the TCP on the plate about its {name}"),
                is_scale: false,
                is_parameter: false,
                change: self.change(&Rule {
                    in_space: &still,
                    direction: &still,
                    travel: &still,
                    on_plate: &|point| unit.cross(&point),
                    longer: Longer::No,
                }),
            });
        }
        motions.push(Motion {
            words: "scale of the whole machine".to_owned(),
            is_scale: true,
            is_parameter: false,
            change: self.change(&Rule {
                in_space: &|point| point,
                direction: &still,
                travel: &|way| way,
                on_plate: &|point| point,
                longer: Longer::InProportion,
            }),
        });
        motions.push(Motion {
            words: "common zero of all drives".to_owned(),
            is_scale: false,
            is_parameter: false,
            change: self.change(&Rule {
                in_space: &still,
                direction: &still,
                travel: &still,
                on_plate: &still,
                longer: Longer::Driven,
            }),
        });
        motions.retain(|motion| motion.change.norm() > 0.0);
        // Parameters that are no point, direction or length may make up for a motion: a scale of drives for the machine's size.
        for (place, &index) in self.used.iter().enumerate() {
            let parameter = &self.machine.variant.parameters[index];
            if !DIMENSIONS.contains(&parameter.quantity.as_str()) {
                let mut change = DVector::zeros(self.values.len());
                change[place] = 1.0;
                motions.push(Motion {
                    words: format!("`{}`", parameter.name),
                    is_scale: false,
                    is_parameter: true,
                    change,
                });
            }
        }
        motions
    }

    /// The motions and changes that a triangle does not see; `scale` are the units of the unknowns.
    pub(super) fn freedoms(&self, reduced: &Reduced, scale: &[f64]) -> Vec<Freedom> {
        let scaled = scaled(&reduced.triangle, scale);
        let (values, v_t) = singular::right(scaled.clone());
        let largest = values.max();
        let open: Vec<usize> = (0..values.len())
            .filter(|&k| values[k] <= OPEN * largest)
            .collect();
        let mut basis: Vec<DVector<f64>> = open.iter().map(|&k| v_t.row(k).transpose()).collect();
        let mut freedoms = vec![];
        let motions: Vec<Motion> = (self.motions().into_iter())
            .map(|mut motion| {
                for (change, scale) in motion.change.iter_mut().zip(scale) {
                    *change /= scale;
                }
                motion.change.normalize_mut();
                motion
            })
            .collect();
        let mut take = |direction: &DVector<f64>,
                        words: String,
                        is_scale: bool,
                        basis: &mut Vec<DVector<f64>>| {
            freedoms.push(Freedom {
                is_motion: !words.starts_with(OF_PARAMETERS),
                words,
                is_scale,
                direction: direction.clone(),
            });
            without(basis, direction);
        };
        let all = basis.clone();
        // A motion that is open by itself; what is left of it once others are taken must still be open.
        let mut used: Vec<&Motion> = vec![];
        for motion in motions.iter().filter(|motion| !motion.is_parameter) {
            let is_open = share(&all, &motion.change) > 1.0 - NAMED;
            if is_open && share(&basis, &motion.change) > INDEPENDENT {
                take(
                    &motion.change,
                    motion.words.clone(),
                    motion.is_scale,
                    &mut basis,
                );
                used.push(motion);
            }
        }
        // Motions that are open together, such as a rotation about an axis that is none of the frame's.
        let together: Vec<&Motion> = motions
            .iter()
            .filter(|motion| !used.iter().any(|known| known.words == motion.words))
            .collect();
        if !together.is_empty() && !basis.is_empty() {
            let columns: Vec<DVector<f64>> = together.iter().map(|m| m.change.clone()).collect();
            let seen = &scaled * DMatrix::from_columns(&columns);
            let svd = seen.svd(false, true);
            if let Some(v_t) = svd.v_t {
                for k in 0..svd.singular_values.len() {
                    if svd.singular_values[k] > 100.0 * OPEN * largest {
                        continue;
                    }
                    let shares = v_t.row(k);
                    let mut direction = DVector::zeros(scale.len());
                    let mut named: Vec<(f64, &Motion)> = vec![];
                    for (share, motion) in shares.iter().zip(&together) {
                        direction.axpy(*share, &motion.change, 1.0);
                        named.push((share.abs(), motion));
                    }
                    if direction.norm() < 1e-6 {
                        continue;
                    }
                    direction.normalize_mut();
                    if share(&basis, &direction) < INDEPENDENT {
                        continue;
                    }
                    largest_first(&mut named, |own| own.0);
                    let most = named[0].0;
                    named.retain(|(share, _)| *share > 0.1 * most);
                    let is_scale = named.iter().any(|(_, motion)| motion.is_scale);
                    take(&direction, together_in_words(&named), is_scale, &mut basis);
                }
            }
        }
        // Closures are homogeneous of degree two: as long as they are not met, a scale changes them in proportion, and
        // makes them the smaller the smaller the machine.
        for motion in motions.iter().filter(|motion| motion.is_scale) {
            let change = motion
                .change
                .component_mul(&DVector::from_column_slice(scale));
            let size = self.scale_of(&change);
            let mut left = (&scaled * &motion.change).insert_row(scale.len(), 0.0) * size;
            left -= &reduced.projected * 2.0;
            let is_known = used.iter().any(|known| known.is_scale);
            if !is_known && left.norm() < NAMED * largest * size {
                take(&motion.change, motion.words.clone(), true, &mut basis);
            }
        }
        for direction in basis.clone() {
            take(
                &direction,
                self.in_parameters(&direction),
                false,
                &mut basis,
            );
        }
        freedoms
    }

    /// Factor by which a change is shorter than that which doubles every dimension.
    fn scale_of(&self, change: &DVector<f64>) -> f64 {
        let motions = self.motions();
        let whole = motions.iter().find(|motion| motion.is_scale);
        whole.map_or(0.0, |whole| whole.change.norm() / change.norm())
    }

    /// A direction by the unknowns that it changes most.
    fn in_parameters(&self, direction: &DVector<f64>) -> String {
        let mut largest: Vec<usize> = (0..direction.len()).collect();
        largest_first(&mut largest, |&place| direction[place].abs());
        let most = direction[largest[0]].abs();
        let named = largest
            .iter()
            .filter(|&&place| direction[place].abs() > 0.2 * most);
        let names: Vec<&str> = named.take(4).map(|&place| self.name(place)).collect();
        format!("{OF_PARAMETERS} {}", names.join(", "))
    }

    fn name(&self, place: usize) -> &str {
        match self.used.get(place) {
            Some(&index) => &self.machine.variant.parameters[index].name,
            None => {
                let mut unknowns = self.objects.iter().flat_map(|object| &object.unknowns);
                let own = unknowns.nth(place - self.used.len());
                own.map_or("?", |unknown| &unknown.name)
            }
        }
    }
}

/// Motions that are open together, those with the largest share first.
fn together_in_words(named: &[(f64, &Motion)]) -> String {
    let mut words: Vec<String> = (named.iter().take(NAMED_TOGETHER))
        .map(|(_, motion)| motion.words.clone())
        .collect();
    match named.len() - words.len() {
        0 => {}
        1 => words.push("one other".to_owned()),
        others => words.push(format!("{others} others")),
    }
    words.join(" with ")
}

/// A triangle with columns in units of the unknowns.
pub(super) fn scaled(triangle: &DMatrix<f64>, scale: &[f64]) -> DMatrix<f64> {
    let mut scaled = triangle.clone();
    for (column, scale) in scale.iter().enumerate() {
        scaled.column_mut(column).scale_mut(*scale);
    }
    scaled
}

/// Length of the part of a unit vector within the span of an orthonormal basis.
fn share(basis: &[DVector<f64>], vector: &DVector<f64>) -> f64 {
    let squares = basis.iter().map(|own| own.dot(vector).powi(2));
    squares.sum::<f64>().sqrt()
}

/// Takes from an orthonormal basis the direction within its span that is nearest to a vector.
fn without(basis: &mut Vec<DVector<f64>>, vector: &DVector<f64>) {
    if basis.is_empty() {
        return;
    }
    let mut nearest = DVector::zeros(vector.len());
    for own in basis.iter() {
        nearest.axpy(own.dot(vector), own, 1.0);
    }
    nearest.normalize_mut();
    let mut left: Vec<DVector<f64>> = vec![];
    // The ones farthest from it first, which lose least.
    smallest_first(basis, |own| own.dot(&nearest).abs());
    for own in basis.iter().take(basis.len().saturating_sub(1)) {
        let mut own = own - &nearest * nearest.dot(own);
        for _ in 0..2 {
            for known in &left {
                let share = known.dot(&own);
                own.axpy(-share, known, 1.0);
            }
        }
        left.push(own.normalize());
    }
    *basis = left;
}

type Map<'a> = &'a dyn Fn(Vector3<f64>) -> Vector3<f64>;

/// Action of a motion on parameters.
struct Rule<'a> {
    /// To points fixed in space.
    in_space: Map<'a>,
    /// To directions in space.
    direction: Map<'a>,
    /// To the way of a cart per command.
    travel: Map<'a>,
    /// To points on the plate.
    on_plate: Map<'a>,
    longer: Longer,
}

enum Longer {
    No,
    InProportion,
    Driven,
}

impl Rule<'_> {
    fn length(&self, length_m: f64, is_driven: bool) -> f64 {
        match self.longer {
            Longer::No => 0.0,
            Longer::InProportion => length_m,
            Longer::Driven => f64::from(u8::from(is_driven)),
        }
    }
}
