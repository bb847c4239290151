"""A user's robot with tracks: a URDF with one arm-like flipper, and its robot file."""

from pathlib import Path

_INERTIA = '<inertia ixx="{0}" iyy="{0}" izz="{0}" ixy="0" ixz="0" iyz="0"/>'
URDF = f"""<robot name="mine">
<link name="base">
  <inertial><origin xyz="0 0 0.12"/><mass value="20"/>{_INERTIA.format(0.5)}</inertial>
  <collision><origin xyz="0 0 0.14"/><geometry><box size="0.5 0.3 0.1"/></geometry></collision>
</link>
<link name="arm">
  <inertial><origin xyz="0.1 0 0"/><mass value="1"/>{_INERTIA.format(0.01)}</inertial>
</link>
<joint name="shoulder" type="revolute">
  <parent link="base"/><child link="arm"/><axis xyz="0 1 0"/><origin xyz="0.2 0.3 0.1"/>
  <limit lower="-1" upper="1" effort="40" velocity="1"/>
</joint>
</robot>
"""
ROBOT = """model = "mine.urdf"
half_gauge = 0.2
hull = [[-0.2, 0.1, 0.1], [0.2, 0.1, 0.1]]
[[flippers]]
body = "arm"
side = "left"
hull = [[0.0, 0.0, 0.06], [0.25, 0.0, 0.04]]
"""


def write_robot(folder: Path, text: str = ROBOT, model: str = URDF) -> Path:
    (folder / "mine.urdf").write_text(model)
    (folder / "mine.toml").write_text(text)
    return folder / "mine.toml"
