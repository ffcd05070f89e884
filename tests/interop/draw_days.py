"""Draws the errors of the days of `isotherm demo --learn --json`, for the manual.

Takes the file with that JSON and the file to write, a page with one chart (HTML with SVG).
"""

import json
import sys

WIDTH, HEIGHT = 935, 351
LEFT, RIGHT, TOP, BOTTOM = 70, 20, 92, 44
SERIES = [
    ("Uncompensated error", "uncompensated_um", "#a4501d", "2 4", 2),
    ("Model alone, without the correction from touches", "model_left_um", "#3b4350", "7 5", 2),
    ("Residual error", "left_um", "#1b7a48", "", 3),
]
STEP = 5


def draw(days):
    count = len(days)
    top = max(day[key][1] for day in days for _, key, *_ in SERIES)
    top = STEP * (int(top / STEP) + 1)

    def x(place):
        return LEFT + (WIDTH - LEFT - RIGHT) * (place + 0.5) / count

    def y(um):
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * um / top

    parts = ['<text x="14" y="28" class="title">Error of each day, RMS</text>']
    along = 14
    for name, _, colour, dashes, width in SERIES:
        parts.append(line([(along, 51), (along + 26, 51)], colour, dashes, width))
        parts.append(f'<text x="{along + 34}" y="56">{name}</text>')
        along += 60 + 7.6 * len(name)
    for um in range(0, top + 1, STEP):
        parts.append(line([(LEFT, y(um)), (WIDTH - RIGHT, y(um))], "#d5dadb", "", 1))
        parts.append(f'<text x="{LEFT - 10}" y="{y(um) + 4}" class="axis" text-anchor="end">{um}</text>')
    parts.append(f'<text x="26" y="{y(top / 2)}" class="axis" transform="rotate(-90 26 {y(top / 2)})" text-anchor="middle">µm</text>')
    before = days[0]["model"]
    for place, day in enumerate(days):
        parts.append(f'<text x="{x(place)}" y="{HEIGHT - 16}" class="axis" text-anchor="middle">day {day["day"]}</text>')
        if day["model"] != before:
            at = (x(place - 1) + x(place)) / 2
            parts.append(line([(at, TOP - 14), (at, HEIGHT - BOTTOM)], "#0f5a80", "3 3", 1.5))
            parts.append(f'<text x="{at}" y="{TOP - 18}" class="mark" text-anchor="middle">adopted</text>')
        before = day["model"]
    for _, key, colour, dashes, width in SERIES:
        points = [(x(place), y(day[key][1])) for place, day in enumerate(days)]
        parts.append(line(points, colour, dashes, width))
        parts += [f'<circle cx="{cx:.1f}" cy="{cy:.1f}" r="3" fill="{colour}"/>' for cx, cy in points]
    return "\n".join(parts)


def line(points, colour, dashes, width):
    points = " ".join(f"{px:.1f},{py:.1f}" for px, py in points)
    return f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{width}" stroke-dasharray="{dashes}"/>'


def main(source, page):
    with open(source) as file:
        days = json.load(file)["days"]
    style = "body { margin: 0 } svg { display: block; background: #fff } text { font: 14px 'DejaVu Sans', sans-serif; fill: #10161c } .title { font-weight: bold; font-size: 15px } .axis { font-size: 12px; fill: #4a545b } .mark { font-size: 12px; fill: #0f5a80 }"
    with open(page, "w") as file:
        file.write(f'<!doctype html><meta charset="utf-8"><style>{style}</style>')
        file.write(f'<svg width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}">{draw(days)}</svg>\n')


main(sys.argv[1], sys.argv[2])
