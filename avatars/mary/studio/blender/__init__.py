# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""What needs Blender as a Python module (`bpy`), and nothing else that is not in Python's or NumPy's house.

`bpy` is under the GPL, version 3 or later; used together with it, the modules of this folder are too.
"""
