//! Poses and commands that cannot be computed, and predictions.

codes! {
    MISSING = 501: "a closure needs a quantity that was not measured";
    NOT_FINITE = 502: "a closure, or a derivative of it, is not a finite number";
    COMMANDS = 503: "there are more or fewer commands than drives";
    SINGULAR = 504: "a pose is singular";
    NOT_CONVERGED = 505: "no pose or commands were found in the iterations allowed";
    UNASSEMBLED = 506: "the arm cannot be assembled near the reference";
    OUT_OF_REACH = 507: "a link does not reach";
    INCONSISTENT = 508: "a pose and commands do not go together";
    NO_REFERENCE = 509: "nothing says how the arm is assembled";
    REFERENCE = 510: "the reference is not a pose of the machine";
    WAY = 511: "the way from the known pose is blocked by a singular one";
    BEHIND = 512: "a singular pose lies between a pose and the known one";
    PARTIAL = 513: "a position does not say which pose is meant";
    TARGET = 514: "the arm cannot be positioned as asked";
    BEYOND_RANGE = 515: "a command is outside the range that calibrated";
    UNCERTAIN = 516: "the position is known less well than at the poses that calibrated";
    NOT_CALIBRATED = 517: "parameters of the variant were not calibrated with the others";
}
