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
    OUT_OF_REACH = 530: "a pose is out of reach";
    MOST_OUT_OF_REACH = 531: "most poses are out of reach";
    TOO_FEW_WITHIN_REACH = 532: "fewer than two poses are within reach";
    NO_REFERENCE = 533: "no reference pose is given";
    REFERENCE_UNASSEMBLED = 534: "the arm cannot be assembled near the reference";
    REFERENCE_SINGULAR = 535: "the machine is singular at its reference";
    NO_ORIENTATION = 536: "a reduced arm needs the mean measured orientation";
    NO_TURN = 537: "the drives cannot turn the plate";
    TURNS = 538: "the command of a crank is far from where the machine is known to stand";
    HALF_OF_POSE = 539: "a target has some columns of a pose but not all";
    NOT_PREDICTED = 540: "a pose was not predicted";
    COMPROMISE = 541: "no pose satisfies all links: the nearest was taken";
    NEAREST_POSE = 542: "the drives cannot give a pose: the nearest was taken";
    BEYOND_RANGE = 543: "commands lie outside the measured range";
    BEYOND_KNOWLEDGE = 544: "the position is less certain than at any pose that calibrated";
    TRACKER_LEFT_OUT = 545: "effects of the tracker are left out";
    NO_COVARIANCE = 546: "a file does not hold the covariance of its values";
    NOISE_UNKNOWN = 547: "the noise of drives or links is not stated";
}
