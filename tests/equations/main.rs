//! Equations: of descriptions, of the arm and of the virtual robot.
//!
//! | file | promise |
//! | --- | --- |
//! | `messages` | each mistake in a description gets its code at its place |
//! | `derivatives` | residuals and Jacobians are those of dual numbers; generated code is the interpreter's |
//! | `reference` | the same equations once more, by hand |
//! | `blocks` | blocks of samples are single samples, and normal equations their products |
//! | `effects` | each effect of the catalogue at each of its places |
//! | `codegen` | the generated code is as small as it was, and follows from the text |
//! | `kinematics` | forward and inverse kinematics undo each other, and say what is impossible |
//! | `layout` | the arm is drawn as it stands |
//! | `simulation` | the virtual robot obeys physics by hand, and has the noise that it is told |
//! | `slow` | long ways by the hundred |

mod blocks;
mod codegen;
mod derivatives;
mod effects;
mod kinematics;
mod layout;
mod messages;
mod reference;
mod simulation;
#[cfg(feature = "slow")]
mod slow;
