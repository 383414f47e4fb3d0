"""Writes the closure equation with ten derivatives as wrenfold and SymForce generate it in Rust.

Usage: python closure.py FOLDER. Writes wrenfold.rs and symforce.rs into the folder, and prints for each
generator its name, version, operations as it counts them, and seconds, separated by tabs. A generator that
is not installed is left out.

The function is L^2 - |T + Rz(alpha) Ry(beta) Rz(gamma) P - (O + q v)|^2; its derivatives are those by L, P, O
and v. Inputs are, in this order, q, T (3), the angles (3), L, P (3), O (3), v (3).
"""

import importlib.metadata
import re
import shutil
import sys
import tempfile
import time
from pathlib import Path

NAMES = "q x y z alpha beta gamma length px py pz ox oy oz vx vy vz".split()
PARAMETERS = NAMES[7:]


def turn_z(angle, v, cos, sin):
    c, s = cos(angle), sin(angle)
    return [c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]]


def turn_y(angle, v, cos, sin):
    c, s = cos(angle), sin(angle)
    return [c * v[0] + s * v[2], v[1], c * v[2] - s * v[0]]


def closure(cos, sin, q, x, y, z, alpha, beta, gamma, length, px, py, pz, ox, oy, oz, vx, vy, vz):
    """The rotations are applied one after the other: the form for which both find the shortest code."""
    joint = turn_z(gamma, [px, py, pz], cos, sin)
    joint = turn_y(beta, joint, cos, sin)
    joint = turn_z(alpha, joint, cos, sin)
    rod = [t + j - o - q * v for t, j, o, v in zip([x, y, z], joint, [ox, oy, oz], [vx, vy, vz])]
    return length * length - rod[0] * rod[0] - rod[1] * rod[1] - rod[2] * rod[2]


def with_wrenfold(folder):
    from wrenfold import FloatScalar, code_generation, sym

    def function(
        q: FloatScalar, x: FloatScalar, y: FloatScalar, z: FloatScalar,
        alpha: FloatScalar, beta: FloatScalar, gamma: FloatScalar,
        length: FloatScalar, px: FloatScalar, py: FloatScalar, pz: FloatScalar,
        ox: FloatScalar, oy: FloatScalar, oz: FloatScalar,
        vx: FloatScalar, vy: FloatScalar, vz: FloatScalar,
    ):
        arguments = [q, x, y, z, alpha, beta, gamma, length, px, py, pz, ox, oy, oz, vx, vy, vz]
        residual = closure(sym.cos, sym.sin, *arguments)
        jacobian = sym.jacobian([residual], arguments[7:])
        return [
            code_generation.OutputArg(expression=sym.matrix([residual]), name="residual"),
            code_generation.OutputArg(expression=jacobian, name="jacobian"),
        ]

    started = time.perf_counter()
    code = code_generation.generate_function(
        function, code_generation.RustGenerator(), name="closure"
    )
    seconds = time.perf_counter() - started
    (folder / "wrenfold.rs").write_text(code)
    return code, seconds


def with_symforce(folder):
    import symforce

    symforce.set_symbolic_api("symengine")
    symforce.set_epsilon_to_number()
    import symforce.symbolic as sf
    from symforce import codegen
    from symforce.codegen.backends.rust.rust_config import RustConfig
    from symforce.values import Values

    symbols = [sf.Symbol(name) for name in NAMES]
    residual = closure(sf.cos, sf.sin, *symbols)
    inputs = Values(**dict(zip(NAMES, symbols)))
    outputs = Values(
        residual=sf.Matrix([residual]),
        jacobian=sf.Matrix([[residual.diff(symbol) for symbol in symbols[7:]]]),
    )
    started = time.perf_counter()
    generated = codegen.Codegen(
        inputs=inputs, outputs=outputs, config=RustConfig(), name="closure"
    ).generate_function(output_dir=tempfile.mkdtemp())
    seconds = time.perf_counter() - started
    code = "\n".join(Path(f).read_text() for f in generated.generated_files)
    shutil.rmtree(generated.output_dir)
    (folder / "symforce.rs").write_text(code)
    return code, seconds


def main():
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, generate in [("wrenfold", with_wrenfold), ("symforce", with_symforce)]:
        try:
            code, seconds = generate(folder)
        except ImportError as error:
            print(f"{name}: {error}", file=sys.stderr)
            continue
        count = re.search(r"total(?: ops)?: (\d+)", code, re.IGNORECASE)
        version = importlib.metadata.version(name)
        print(name, version, count.group(1) if count else "-", f"{seconds:.4f}", sep="\t")


main()
