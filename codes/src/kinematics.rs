//! Poses and commands that cannot be computed, and predictions.

codes! {
    MISSING = 501: "a closure needs a quantity that was not measured";
    NOT_FINITE = 502: "a closure, or a derivative of it, is not a finite number";
    COMMANDS = 503: "there are more or fewer commands than drives";
    SINGULAR = 504: "a pose is singular";
    NOT_CONVERGED = 505: "no pose or commands were found in the iterations allowed";
    TOO_SHORT = 507: "a link does not reach";
    INCONSISTENT = 508: "a pose and commands do not go together";
    REFERENCE = 510: "the reference is not a pose of the machine";
    WAY = 511: "the way from the known pose is blocked by a singular one";
    BEHIND = 512: "a singular pose lies between a pose and the known one";
    PARTIAL = 513: "a position does not say which pose is meant";
    TARGET = 514: "the arm cannot be positioned as asked";
    NOT_CALIBRATED = 517: "parameters of the variant were not calibrated with the others";
    NO_REFERENCE = 533: "no reference pose is given";
    REFERENCE_UNASSEMBLED = 534: "the arm cannot be assembled near the reference";
    BEYOND_RANGE = 543: "commands lie outside the measured range";
    BEYOND_KNOWLEDGE = 544: "the position is less certain than at any pose that calibrated";
}
