"""A chain of flexible rings in MuJoCo that is pulled at both ends, watched live in lockstep.

    pip install ./bindings/python mujoco-core
    linkwatch watch --service chain                             # in another terminal
    python examples/python/attach_mujoco.py                     # the chain holds
    python examples/python/attach_mujoco.py --contact-time 0.3  # too soft: it comes apart
    python examples/python/attach_mujoco.py --step 0.05         # a time step that is too long ..
    python examples/python/attach_mujoco.py --step 0.05 --roll-back           # .. is halved
"""

import argparse

import linkwatch
import mujoco

parser = argparse.ArgumentParser()
parser.add_argument("--service", default="chain")
parser.add_argument("--step", type=float, default=0.01)
parser.add_argument("--contact-time", type=float, default=0.02)
parser.add_argument("--roll-back", action="store_true")
args = parser.parse_args()

rings = "".join(
    f"""<flexcomp name="{k}" type="circle" dim="1" count="14 1 1" spacing=".5 .5 .5" mass="1"
          pos="{1.2 * k} 0 0" euler="{90 * (k % 2)} 0 0" radius="0.15"><edge equality="true"/>
        <contact selfcollide="none" solref="{args.contact_time} 1"/></flexcomp>"""
    for k in range(32)
)
m = mujoco.MjModel.from_xml_string(
    f"""<mujoco><option timestep="{args.step}" gravity="0 0 0" solver="CG" iterations="20"/>
        <worldbody>{rings}</worldbody></mujoco>"""
)
d = mujoco.MjData(m)
counts, bodies = -m.flex_vertnum, m.flex_vertbodyid  # negative: closed curves
first, last = bodies[: -counts[0]], bodies[counts[-1] :]

with linkwatch.Client(args.service, counts=counts, radii=m.flex_radius, lockstep=True) as sim:
    if not sim.wait_for_watcher():
        raise SystemExit(f"start this first: linkwatch watch --service {args.service}")
    while d.time < 3:
        mujoco.mj_forward(m, d)  # the positions of the vertices
        sim.begin(d.time)[:] = d.flexvert_xpos
        sim.publish()
        verdict = sim.wait()
        if verdict is None:
            raise SystemExit(sim.no_verdict)
        if not verdict.abort:
            before, step = d.qpos.copy(), m.opt.timestep
            d.xfrc_applied[first, 0], d.xfrc_applied[last, 0] = -5, 5  # the pull
            d.qvel *= 1 - step  # drag
            mujoco.mj_step(m, d)
        elif args.roll_back and step > 1e-4:  # to half of the part of the step that is safe
            fraction = 0.5 * (verdict.safe_fraction or 0)
            d.qpos, d.qvel = before + fraction * (d.qpos - before), 0
            d.time, m.opt.timestep = d.time - (1 - fraction) * step, step / 2
            sim.resume()
        else:
            break
print(sim.aborted or f"{d.time:.2f} s: every link is intact")
raise SystemExit(1 if sim.aborted else 0)
