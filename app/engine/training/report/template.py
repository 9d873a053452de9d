"""The page around the sections."""

from __future__ import annotations

from string import Template

PAGE = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
:root { color-scheme: light dark; --paper: #fbfaf7; --ink: #22252b; --pale: #6a6f7a; --line: #dddbd4; --mark: #b3392c; }
@media (prefers-color-scheme: dark) {
  :root { --paper: #16181c; --ink: #e4e3df; --pale: #9a9ea8; --line: #33363d; --mark: #ef8a7a; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 72rem; padding: 1rem 1.25rem 4rem; background: var(--paper); color: var(--ink);
  font: 15px/1.5 system-ui, sans-serif; overflow-wrap: anywhere; }
h1 { font-size: 1.6rem; margin: 1rem 0 0; }
h2 { font-size: 1.2rem; margin: 2.5rem 0 .75rem; padding-top: .75rem; border-top: 1px solid var(--line); }
h3 { font-size: 1rem; margin: 1.5rem 0 .5rem; }
p { max-width: 52rem; }
.date, figcaption, dt, th { color: var(--pale); }
dl { display: grid; grid-template-columns: minmax(7rem, max-content) 1fr; gap: .25rem 1rem; margin: 0; }
dd { margin: 0; }
.scroll { overflow-x: auto; margin: .75rem 0; }
table { border-collapse: collapse; }
table.wide { width: 100%; min-width: 34rem; }
th, td { text-align: left; vertical-align: top; padding: .25rem .9rem .25rem 0; border-bottom: 1px solid var(--line);
  overflow-wrap: normal; white-space: nowrap; }
table.wide td { overflow-wrap: anywhere; white-space: normal; }
th { font-weight: 500; }
strong { color: var(--mark); font-weight: 600; }
img { display: block; max-width: 100%; height: auto; border-radius: 3px; }
img.plot { background: #fff; }
img.long { max-width: none; width: min(100%, 76rem); min-width: 44rem; }
img.small { width: clamp(4.5rem, 17vw, 8rem); max-width: none; }
img.wheel { display: inline-block; width: 3.5rem; border-radius: 50%; vertical-align: middle; }
figure { margin: 0; }
figcaption { font-size: 11px; line-height: 1.35; padding: .2rem 0; }
.grid { display: grid; grid-template-columns: repeat(auto-fill, minmax(6.5rem, 1fr)); gap: .6rem; }
.grid img { width: 100%; }
.reference img { outline: 3px solid var(--mark); }
.seam { display: grid; grid-template-columns: repeat(auto-fit, minmax(8rem, 14rem)); gap: .5rem; }
video { width: 100%; max-width: 60rem; display: block; border-radius: 3px; background: #000; }
meter { width: clamp(3rem, 12vw, 8rem); }
</style>
</head>
<body>
<h1>$title</h1>
<p class="date">$written</p>
$content
</body>
</html>
""")
