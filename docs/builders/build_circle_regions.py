"""Draw docs/figures/circle_regions.svg: the regions of a sensor on an opaque circle under a concentric reflector.

Run it from the root of the repository: ``python docs/builders/build_circle_regions.py``. Heights are exaggerated: the
reflector has 1.2 times the radius of the ground.
"""

from __future__ import annotations

import cmath
import math
from pathlib import Path

GROUND, REFLECTOR = 1.0, 1.2
SIZE, SCALE, TOP = (780, 450), 325.0, 440.0
HALF = math.acos(GROUND / REFLECTOR)


def arc(radius: float, start: float, end: float) -> list[complex]:
    """Points of an arc; angles are measured from the sensor at the top."""
    return [cmath.rect(radius, start + (end - start) * k / 60) for k in range(61)]


def path(points: list[complex], close: bool = False) -> str:
    """SVG path data; the real axis points up, angles increase to the right."""
    points_px = [f"{SIZE[0] / 2 + SCALE * point.imag:.1f},{TOP - SCALE * point.real:.1f}" for point in points]
    return "M" + " L".join(points_px) + ("Z" if close else "")


def text(point: complex, words: str, anchor: str = "middle") -> str:
    """A label as an SVG element."""
    x, y = SIZE[0] / 2 + SCALE * point.imag, TOP - SCALE * point.real
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{words}</text>'


def main() -> None:
    """Write the picture."""
    sensor, highest = cmath.rect(GROUND, 0.0), cmath.rect(REFLECTOR, HALF)
    farthest = cmath.rect(GROUND, 2.0 * HALF)
    shapes = []
    for side in (1.0, -1.0):

        def turned(points: list[complex], side: float = side) -> list[complex]:
            return [complex(point.real, side * point.imag) for point in points]

        seen = [*arc(GROUND, 0.0, 2.0 * HALF), highest, *arc(REFLECTOR, HALF, 0.0)]
        direct = [sensor, highest, *arc(REFLECTOR, HALF, 0.0)]
        hidden = [farthest, highest, *arc(REFLECTOR, HALF, math.pi / 2), *arc(GROUND, math.pi / 2, 2.0 * HALF)]
        shapes += [
            f'<path d="{path(turned(seen), True)}" fill="#cfe3f5"/>',
            f'<path d="{path(turned(direct), True)}" fill="#dcebd2"/>',
            f'<path d="{path(turned(hidden), True)}" fill="#eee"/>',
        ]
    hit, source_radius = cmath.rect(REFLECTOR, 0.3), 1.06
    ray = (hit - sensor) / abs(hit - sensor)
    back = -((hit / REFLECTOR) ** 2) * ray.conjugate()
    along = min(t / 1000 for t in range(1000) if abs(hit + back * t / 1000) < source_radius)
    source = hit + back * along
    image = hit - back * abs(hit - sensor) * 0.3
    lines = [
        f'<path d="{path(arc(GROUND, -math.pi / 2, math.pi / 2))}" class="edge"/>',
        f'<path d="{path(arc(REFLECTOR, -math.pi / 2, math.pi / 2))}" class="edge"/>',
        f'<path d="{path([sensor, highest, farthest])}" class="thin"/>',
        f'<path d="{path([sensor, highest.conjugate(), farthest.conjugate()])}" class="thin"/>',
        f'<path d="{path([sensor, hit, source])}" class="ray"/>',
        f'<path d="{path([hit, image])}" class="ray" stroke-dasharray="5 4"/>',
        *(
            f'<circle cx="{SIZE[0] / 2 + SCALE * point.imag:.1f}" cy="{TOP - SCALE * point.real:.1f}" r="4"/>'
            for point in (sensor, hit, source)
        ),
    ]
    labels = [
        text(sensor - 0.06, "sensor"),
        text(cmath.rect(1.25, 0.28), "hit"),
        text(source + complex(-0.05, 0.07), "source", "start"),
        text(image + complex(0.0, -0.03), "the ray, unfolded", "end"),
        text(cmath.rect(1.14, -0.1), "A3"),
        text(cmath.rect(1.07, -0.7), "A2"),
        text(cmath.rect(1.07, 0.7), "A2"),
        text(cmath.rect(1.12, -1.4), "A1"),
        text(cmath.rect(1.12, 1.4), "A1"),
        text(complex(0.55, 0.0), "opaque circle (ground)"),
        text(cmath.rect(1.24, -0.5), "reflector", "end"),
    ]
    style = (
        "text{font:15px sans-serif}.edge{fill:none;stroke:#333;stroke-width:2}"
        ".thin{fill:none;stroke:#666}.ray{fill:none;stroke:#c33;stroke-width:2}"
    )
    content = "\n".join(["<style>" + style + "</style>", *shapes, *lines, *labels])
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIZE[0]} {SIZE[1]}">\n{content}\n</svg>\n'
    (Path(__file__).parents[1] / "figures" / "circle_regions.svg").write_text(svg, encoding="utf-8")


if __name__ == "__main__":
    main()
