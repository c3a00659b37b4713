"""A chain of flexible rings in MuJoCo that is pulled at both ends, watched live.

    pip install ./bindings/python mujoco-core
    linkwatch watch --service chain                         # in another terminal

    python examples/python/chain_mujoco.py                           # the chain holds
    python examples/python/chain_mujoco.py --step 0.05               # the time step is too large
    python examples/python/chain_mujoco.py --contact-time 0.3        # the contacts are too soft
    python examples/python/chain_mujoco.py --step 0.05 --roll-back   # goes on with smaller steps

Rings are flexes of MuJoCo, closed curves of 13 vertices; their positions are `d.flexvert_xpos`.
With --roll-back the simulation returns to a moment before the first pull-through and goes on with
half the time step.
"""

import argparse

import linkwatch
import mujoco

RINGS, COUNT = 32, 14
PULL, DRAG = 5.0, 1.0
END_TIME, SMALLEST_STEP = 3.0, 1e-4


def model(step, contact_time):
    """Returns a chain of rings in alternating planes."""
    ring = """
      <flexcomp name="{k}" type="circle" dim="1" count="{COUNT} 1 1" spacing=".5 .5 .5" mass="1"
          pos="{x} 0 0" euler="{angle} 0 0" radius="0.15">
        <edge equality="true"/>
        <contact selfcollide="none" solref="{contact_time} 1"/>
      </flexcomp>"""
    rings = [
        ring.format(k=k, COUNT=COUNT, x=1.2 * k, angle=90 * (k % 2), contact_time=contact_time)
        for k in range(RINGS)
    ]
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="{step}" gravity="0 0 0" solver="CG" iterations="20" jacobian="sparse"/>
      <worldbody>{"".join(rings)}</worldbody>
    </mujoco>""")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--service", default="chain", help="service of linkwatch watch")
    parser.add_argument("--step", type=float, default=0.01, help="time step")
    parser.add_argument("--contact-time", type=float, default=0.02, help="softness of contacts")
    parser.add_argument("--roll-back", action="store_true", help="roll back and go on")
    args = parser.parse_args()

    m = model(args.step, args.contact_time)
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    counts = [-n for n in m.flex_vertnum.tolist()]  # minus says closed
    first = m.flex_vertbodyid[: -counts[0]]
    last = m.flex_vertbodyid[counts[-1] :]

    names = [f"ring {k}" for k in range(RINGS)]
    with linkwatch.Client(
        args.service,
        counts=counts,
        names=names,
        radii=m.flex_radius,
        time_step=args.step,
        dtype="float64",
        lockstep=True,
    ) as sim:
        if not sim.wait_for_watcher():
            raise SystemExit(f"no watcher came: linkwatch watch --service {args.service}")
        before = d.qpos.copy()
        while d.time < END_TIME:
            sim.begin(d.time)[:] = d.flexvert_xpos
            sim.publish()
            verdict = sim.wait()
            if verdict is None:
                raise SystemExit(sim.no_verdict)
            if verdict.abort:
                print(verdict)
                if not args.roll_back:
                    raise SystemExit(1)
                if m.opt.timestep / 2 < SMALLEST_STEP:
                    raise SystemExit("two rings are stuck; an earlier state would be needed")
                # The vertices are slide joints, so positions are linear in qpos. Half of the safe
                # fraction, because two rings touch at the moment itself.
                share = 0.5 * (verdict.safe_fraction or 0.0)
                d.qpos[:] = before + share * (d.qpos - before)
                d.qvel[:] = 0
                d.time -= (1 - share) * m.opt.timestep
                m.opt.timestep /= 2
                mujoco.mj_forward(m, d)
                sim.resume()
                print(f"rolled back to {d.time:.4f}; the time step is {m.opt.timestep} now")
                continue
            before = d.qpos.copy()
            d.xfrc_applied[first, 0] = -PULL
            d.xfrc_applied[last, 0] = PULL
            d.qvel *= 1 - DRAG * m.opt.timestep
            mujoco.mj_step(m, d)
            mujoco.mj_kinematics(m, d)
            mujoco.mj_flex(m, d)
        print(f"{RINGS} rings in {d.time:.2f} s: every link is intact")
        print(sim.finish())


if __name__ == "__main__":
    main()
