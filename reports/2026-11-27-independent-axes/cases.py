N, NM, A, V = ('N', 1.), ('Nm', 1.), ('A', 1.), ('V', 1.)
Mm, MM, RAD, DEG, TURN = ('m', 1.), ('mm', 1e-3), ('rad', 1.), ('deg', np.pi/180), ('turns', 2*np.pi)
def cas(M, bw=8., G=1., ff=1., **k):  # P/PI cascade of bandwidth bw Hz
    w = 2*np.pi*bw; return dict(M=M, mode=1, Kp_p=w/4, Kp_v=M*w, Ki=M*w*w/6, Mff=M*ff, vfilt=1/(2*np.pi*bw*8), G=G, **k)
# ---------------- null cases
case('null_conveyor', 'belt conveyor, servo drive, measured force', cas(38, 5, Fc=24, Fv=60, off=6),
     [lambda i=i: scurve(25, 1000, 1.2, 4, .08, -1.5, 1.5, i) for i in range(3)], 500, 1000, N, Mm, 2e-5, 2.5, True, {})
case('null_dcstage', 'DC motor rotary stage, current, counts', cas(2.1e-4, 12, G=.053, Fc=.009, Fv=6e-4, off=-.002),
     [lambda i=i: xva(multisine(15, 1000, .3, 12, 14, 1.3*(1-.2*i), i+5), 1000) for i in range(2)], 1000, 1000, A, TURN, 2*np.pi/16384, .006, True, {})
case('null_wheel', 'robot wheel, voltage command, back-EMF', dict(M=.012, mode=0, G=.35/1.1, Gb=.35*.35/1.1, Fc=.11, Fv=.01, off=.03),
     [lambda i=i: col(prbs(30, 200, .15, 6, i+3, (-1, -.5, .5, 1))) for i in range(2)], 200, 200, V, DEG, 2*np.pi/8192, .12, True, {},
     note='measured terminal voltage, held within a sample')
case('null_ballscrew', 'ball screw motor side torque', cas(1.6e-3, 18, Fc=.12, Fv=.004, off=.05),
     [lambda i=i: (scurve(12, 2000, 90, 900, .03, -60, 60, i+1) if i % 2 == 0 else xva(chirp(12, 2000, .5, 20, 20., 1.2), 2000)) for i in range(3)],
     2000, 2000, NM, RAD, 2*np.pi/2**20, .015, True, {})
case('null_velset', 'linear axis with a velocity drive, setpoint mm/s', dict(M=4., mode=2, vKp=160., vKi=1400., Fc=9., Fv=12., off=3.),
     [lambda i=i: col(scurve(30, 1000, .4, 2.5, .05, -.3, .3, i+2)[:, 1]) for i in range(2)], 250, 1000, ('mm/s', 1e-3), MM, 1e-6, .0006, False, {})
# ---------------- catalogue effects
case('cogging', 'iron-core linear motor stage', cas(6.2, 20, Fc=7, Fv=18, off=0, ripA=4., ripB=-2.5, ripP=.032),
     [lambda i=i: scurve(10, 5000, .5, 4, .03, -.2, .2, i+1, .1) for i in range(2)], 5000, 5000, N, Mm, 1e-7, 1.0, True,
     {'drive.ripple.motor': dict(amplitude=np.hypot(4, 2.5), period_m=.032)})
case('stribeck', 'ball screw with preload, slow moves', cas(2.4e-3, 20, Fc=.15, Fv=.012, off=.02, Fs=.12, vs=.5, sdel=2),
     [lambda i=i: scurve(30, 1000, 2.5, 30, .05, -2.5, 2.5, i+4, .3, (.02, 1)) for i in range(3)], 1000, 1000, NM, RAD, 2*np.pi/2**20, .008, True,
     {'drive.friction.stribeck': dict(force_n=.12, velocity_m_per_s=.5, exponent=2)})
case('presliding', 'harmonic-drive joint, small reversals, current', cas(.9, 6, G=8.4, Fc=0, Fv=6., off=1., dF=7., dd=.006),
     [lambda i=i: xva(multisine(25, 1000, .15, 3, 10, .06, i+8), 1000) for i in range(2)], 1000, 1000, A, DEG, 2*np.pi/2**19, .02, True,
     {'drive.friction.presliding': dict(force_n=7/8.4, distance_m=.006)})
case('pendulum', 'driven pendulum +-2 rad', cas(.8, 3, Fc=.25, Fv=.12, off=0, grav=5.),
     [lambda i=i: scurve(25, 500, 3, 8, .1, -2.2, 2., i+1) for i in range(2)], 500, 500, NM, RAD, 2*np.pi/20000, .12, True,
     {'drive.ripple.motor': dict(amplitude=5., period_m=2*np.pi)}, note='gravity of an arm; docs: named as spring or ripple of one turn')
case('elevator', 'elevator without compensation rope: gravity offset and negative stiffness', cas(1900, 1.2, Fc=420, Fv=150, off=-2600, kq=-45.),
     [lambda i=i: scurve(60, 1000, 1.6, .9, .5, -14, 14, i+1, 1., (.5, 1)) for i in range(3)], 200, 1000, ('kN', 1e3), Mm, 1e-4, 40, True,
     {'gantry.stiffness': dict(stiffness_n_per_m=-45.)})
case('deadband', 'printer carriage, H-bridge with dead time, voltage', cas(.35, 12, G=2.2, Gb=2.2*1.9, Fc=.7, Fv=.8, off=0, dbu0=1.2, dbs=1., ulim=24),
     [lambda i=i: scurve(20, 1000, .7, 14, .02, -.15, .15, i+1, .1) for i in range(3)], 1000, 1000, V, MM, 5e-6, .08, False,
     {'drive.input_deadband': dict(threshold=1.2, lost_fraction=1.)})
case('fan', 'fan wheel with aerodynamic drag, turns, 100 Hz', cas(.06, 1.5, Fc=.05, Fv=.003, off=.0, Fq=1.1e-4),
     [lambda i=i: np.c_[(lambda v: (np.cumsum(v)/1000, v, np.gradient(v, 1e-3)))(np.convolve(steps(50, 1000, 95, 3, i+1), np.ones(900)/900, 'same'))][0:3].T if False else
      (lambda v: np.c_[np.cumsum(v)/1000, v, np.gradient(v, 1e-3)])(np.convolve(np.convolve(steps(50, 1000, 95, 3, i+1), np.ones(700)/700, 'same'), np.ones(300)/300, 'same')) for i in range(2)],
     100, 1000, NM, TURN, 2*np.pi/10000, .02, True, {'drive.friction.quadratic': dict(coefficient=1.1e-4)})
case('hydraulic', 'hydraulic cylinder: unequal seals and orifice drag', cas(120, 6, Fc=260, Fv=300, off=90, asv=420, asc=110, Fq=900),
     [lambda i=i: scurve(25, 1000, .9, 3, .06, -.5, .5, i+1, .2, (.15, 1)) for i in range(3)], 500, 1000, ('kN', 1e3), MM, 2e-6, 20, True,
     {'drive.friction.asymmetric': dict(viscous_difference_n_s_per_m=420, coulomb_difference_n=110), 'drive.friction.quadratic': dict(coefficient=900)})
case('warmup', 'gearbox warming up, 60 s', cas(.5, 4, G=1.7, Fc=3.2, Fv=.7, off=.3, thc=-1.3, thv=-.25, thT=18),
     [lambda i=i: scurve(60, 1000, 4, 15, .06, -6, 6, i+1, .2) for i in range(2)], 200, 1000, A, RAD, 2*np.pi/65536, .05, True,
     {'drive.friction.thermal_drift': dict(coulomb_change_n=-1.3/1.7, viscous_change_n_s_per_m=-.25/1.7, time_constant_s=18)})
case('bumper', 'linear stage into rubber bumpers', cas(3., 10, Fc=4, Fv=9, off=1, esk=2500., eslo=-.21, eshi=.20),
     [lambda i=i: scurve(20, 1000, .6, 5, .04, -.225, .218, i+1, .1, (.3, 1), i == 0) for i in range(2)], 1000, 1000, N, Mm, 1e-6, .4, True,
     {'gantry.endstop': dict(stiffness_n_per_m=2500, low_m=-.21, high_m=.20)})
case('fieldbus', 'servo, current command delayed by fieldbus 6 ms', cas(.02, 6, G=.4, Fc=.06, Fv=.02, off=.03, delay=.006, noise=.008),
     [lambda i=i: xva(multisine(20, 1000, .4, 6, 12, .08, i+2), 1000) for i in range(2)], 1000, 1000, A, RAD, 2*np.pi/2**17, .0, False,
     {'drive.delay': dict(delay_s=.006)})
case('amplag', 'voice-coil stage, slow amplifier, 2 kHz', cas(.6, 12, Fc=.5, Fv=3, off=0, lag=.004, noise=.15),
     [lambda i=i: xva(multisine(12, 2000, .5, 25, 15, .0012, i+2)+multisine(12, 2000, .2, 1, 3, .012, i+9), 2000) for i in range(2)], 2000, 2000, N, MM, 1e-8, .0, False,
     {'drive.current_loop|drive.lag1': dict(time_constant_s=.004)})
case('spindle', 'spindle axis, torque command with falling torque curve', dict(M=.02, mode=0, G=1, Fc=.2, Fv=.004, off=.05, tsF=3.2, tsv0=75., noise=.04),
     [lambda i=i: col(prbs(25, 500, .5, 2.6, i+3, (-1, -.6, .6, 1))*.9) for i in range(3)], 500, 500, NM, RAD, 2*np.pi/40000, .03, False,
     {'drive.saturation.torque_speed': dict(force_n=3.2, speed_m_per_s=75.)})
case('crank', 'crank/scotch drive: inertia changes with angle', cas(.9, 5, Fc=.8, Fv=.35, off=.1, m1=.22, m2=.12),
     [lambda i=i: xva(multisine(30, 500, .15, 1.3, 10, .7, i+2), 500) for i in range(2)], 500, 500, NM, RAD, 2*np.pi/2**16, .35, True,
     {'gantry.mass_position': dict(slope_kg_per_m=.22, curvature_kg_per_m2=.12)}, note='origin shifts to middle of range')
case('rail', 'misaligned rail: friction varies along travel', cas(12, 8, Fc=22, Fv=30, off=-4, fpA=9., fpB=4., fpL=.35),
     [lambda i=i: scurve(25, 1000, .5, 3, .05, -.4, .4, i+1, .2) for i in range(2)], 1000, 1000, N, Mm, 1e-6, 1.5, True,
     {'drive.friction.position': dict(amplitude=np.hypot(9, 4), length_m=.35)})
case('slew', 'mobile robot wheel, velocity setpoint in rad/s with ramp limit', dict(M=.05, mode=2, vKp=.9, vKi=5., Fc=.2, Fv=.05, off=0, slew=60., noise=.004),
     [lambda i=i: col(steps(40, 100, 12, 1.0, i+1)) for i in range(3)], 100, 100, ('rad/s', 1.), RAD, 2*np.pi/16384, .06, False,
     {'drive.saturation.slew': dict(limit_m_per_s2=60.)})
case('worm', 'worm gear: friction grows with load', cas(.09, 5, Fc=.5, Fv=.12, off=.9, Kl=.22),
     [lambda i=i: xva(multisine(25, 1000, .2, 3, 10, .4, i+2), 1000) for i in range(3)], 1000, 1000, NM, RAD, 2*np.pi/2**17, .04, True,
     {'drive.friction.load': dict(coefficient=.22)})
case('flexure', 'flexure stage with spring and cogging', cas(1.2, 15, Fc=.8, Fv=4, off=.5, kq=420., ripA=.9, ripB=.5, ripP=.006),
     [lambda i=i: scurve(15, 2000, .08, .8, .03, -.02, .02, i+1, .1) for i in range(2)], 2000, 2000, N, MM, 1e-8, .12, True,
     {'gantry.stiffness': dict(stiffness_n_per_m=420), 'drive.ripple.motor': dict(amplitude=np.hypot(.9, .5), period_m=.006)})
# ---------------- not in the catalogue
case('payload', 'pick and place: payload carried one way only', cas(5., 8, Fc=8, Fv=14, off=0, pay=2.5, payhi=.27, paylo=-.27),
     [lambda i=i: scurve(25, 1000, .9, 6, .05, -.3, .3, i+1, .2, (.4, 1), True) for i in range(2)], 1000, 1000, N, Mm, 1e-6, .8, True,
     {'UNKNOWN': dict(what='mass 5 kg, 7.5 kg from right to left')})
case('hotfriction', 'friction rises with temperature from friction work, cools when idle', cas(.4, 5, Fc=2., Fv=.3, off=.1, tmpk=.09, tmptau=6., tmpr=1.6),
     [lambda i=i: (lambda a, b, c: np.vstack([a[:-1], np.c_[b[:-1, 0]-b[0, 0]+a[-1, 0], b[:-1, 1:]], np.c_[c[:, 0]-c[0, 0]+b[-1, 0]-b[0, 0]+a[-1, 0], c[:, 1:]]]))(
       scurve(14, 500, 8, 40, .05, -8, 8, i+1, .1, (.7, 1)), scurve(14, 500, .8, 10, .05, -1, 1, i+2, .6), scurve(14, 500, 8, 40, .05, -8, 8, i+3, .1, (.7, 1))) for i in range(2)],
     500, 500, NM, RAD, 2*np.pi/65536, .06, True, {'UNKNOWN': dict(what='Coulomb + 0.09*temp, temp from friction power, tau 6 s')})
case('pump', 'axis beside a pulsating pump: force periodic in time 6.3 Hz', cas(9., 8, Fc=10, Fv=20, off=3, dist=4., distf=6.3),
     [lambda i=i: scurve(25, 500, .6, 4, .05, -.4, .4, i+1, .2) for i in range(2)], 500, 500, N, MM, 1e-6, .8, True,
     {'UNKNOWN': dict(what='4 N sine in time, 6.3 Hz')})
# ---------------- experiments around cases
def variant(new, base, p={}, **kw):
    c = dict(CASES[base]); c['p'] = {**c['p'], **p}; c.update(kw); c['note'] = f'experiment on {base}'; CASES[new] = c
variant('x_velset_1k', 'null_velset', fs=1000)
variant('x_velset_noki', 'null_velset', p=dict(vKi=0.))
variant('x_velset_clean', 'null_velset', unoise=1e-6)
variant('x_velset_nodwell', 'null_velset', refs=[lambda i=i: col(multisine(30, 1000, .1, 2, 9, .2, i+2)) for i in range(2)])
variant('x_velset_seed', 'null_velset', refs=[lambda i=i: col(scurve(30, 1000, .4, 2.5, .05, -.3, .3, i+42)[:, 1]) for i in range(3)])
variant('x_slew_500', 'slew', fs=500, fc=100)
variant('x_slew_none', 'slew', p=dict(slew=0.), effects={})
variant('x_slew_fc1k', 'slew', fs=500, fc=500, refs=[lambda i=i: col(steps(40, 500, 12, 1.0, i+1)) for i in range(3)])
variant('x_payload_clean', 'payload', p=dict(payhi=.2995, paylo=-.2995))
variant('x_hyd_noquad', 'hydraulic', p=dict(Fq=0.), effects={'drive.friction.asymmetric': dict(viscous_difference_n_s_per_m=420, coulomb_difference_n=110)})
for nm, kw in dict(a=dict(Fc=0., off=0.), b=dict(off=0.), c=dict(off=0., Fc=3.), d=dict(off=0., vKp=640., vKi=5600.), e=dict(off=0., vKi=0.)).items():
    variant('x_vs_'+nm, 'x_velset_nodwell', p=kw)
    variant('x_vsd_'+nm, 'null_velset', p=kw)
# ================ batch 2
B1 = set(CASES)
case('null2_gantry', 'gantry, large Coulomb, multisine, 250 Hz', cas(15, 6, Fc=60, Fv=40, off=5),
     [lambda i=i: xva(multisine(30, 1000, .15, 2, 9, .12, i+2), 1000) for i in range(2)], 250, 1000, N, Mm, 1e-6, 2., True, {})
case('null2_steps100', 'small servo, step sequence, current, 100 Hz', cas(.004, 4, G=.12, ff=0, Fc=.03, Fv=.004, off=.01, ulim=4.),
     [lambda i=i: (lambda x: np.c_[x, 0*x, 0*x])(steps(40, 500, 1.5, 1.2, i+1)) for i in range(3)], 100, 500, A, DEG, 2*np.pi/16384, .02, True, {})
case('null2_volt', 'gear motor, voltage, coarse encoder 2000 counts', cas(.0012, 6, G=.06/.9, Gb=.06*.06/.9, Fc=.02, Fv=.0004, off=0, ulim=24),
     [lambda i=i: scurve(20, 1000, 60, 500, .03, -60, 60, i+1, .2) for i in range(2)], 1000, 1000, V, TURN, 2*np.pi/2000, .1, False, {})
case('null2_valve', 'rotary valve, slow creeping moves', cas(.02, 8, Fc=.8, Fv=.4, off=.1),
     [lambda i=i: xva(multisine(40, 1000, .05, .6, 6, .4, i+2), 1000) for i in range(2)], 500, 1000, NM, DEG, 2*np.pi/2**18, .02, True, {})
case('null2_prbs', 'linear motor, PRBS force, 500 Hz', dict(M=4, mode=0, G=1, Fc=5, Fv=25, off=0, noise=.3),
     [lambda i=i: col(prbs(25, 500, .1, 22, i+3, (-1, -.6, .6, 1))) for i in range(2)], 500, 500, N, MM, 1e-6, .3, True, {})
case('null2_chirp5k', 'voice coil, 5 kHz chirp, commanded current', cas(.25, 30, G=9., Fc=.3, Fv=1.2, off=.2, noise=.06),
     [lambda i=i: xva(chirp(10, 5000, 0.5+.2*i, 60, .03, 1.3), 5000) for i in range(2)], 5000, 5000, A, Mm, 1e-8, .006, False, {})
case('harmonic2', 'harmonic drive: Stribeck and 2/rev ripple', cas(.9, 6, G=8.4, Fc=5., Fv=6., off=1., Fs=3., vs=.12, sdel=2, ripA=1.6, ripB=.8, ripP=np.pi),
     [lambda i=i: scurve(40, 1000, 1.2, 6, .05, -2.5, 2.5, i+8, .2, (.03, 1)) for i in range(3)], 1000, 1000, A, DEG, 2*np.pi/2**19, .02, True,
     {'drive.friction.stribeck': dict(force_n=3/8.4, velocity_m_per_s=.12, exponent=2), 'drive.ripple.motor': dict(amplitude=np.hypot(1.6, .8)/8.4, period_m=np.pi)})
case('clip', 'positioner, amplifier limited to 18 N, commanded force larger', cas(2.2, 10, Fc=2, Fv=6, off=0, clip=18., noise=.15, ulim=60),
     [lambda i=i: scurve(20, 1000, .8, 8, .02, -.3, .3, i+1, .1) for i in range(2)], 1000, 1000, N, MM, 1e-6, .1, False,
     {'drive.saturation.speed': dict(limit_m_per_s=18.)})
case('sag', 'battery wheel: supply sags with power, commanded torque', cas(.05, 2.5, Fc=.15, Fv=.03, off=0, sagk=.0012, sagT=.02, noise=.015),
     [lambda i=i: scurve(30, 500, 25, 50, .1, -60, 60, i+1, .1, (.4, 1)) for i in range(3)], 500, 500, NM, RAD, 2*np.pi/32768, .01, False,
     {'drive.supply_sag': dict(fraction_per_w=.0012, time_constant_s=.02)})
case('agv', 'AGV wheel, velocity setpoint delayed 60 ms by wireless, small friction', dict(M=.05, mode=2, vKp=.9, vKi=5., Fc=.0, Fv=.05, off=0, delay=.06, noise=.004),
     [lambda i=i: col(scurve(40, 100, 12, 30, .1, -20, 20, i+1, .3)[:, 1]) for i in range(2)], 100, 100, ('rad/s', 1.), RAD, 2*np.pi/16384, .03, False,
     {'drive.delay': dict(delay_s=.06)})
case('fandelay', 'thruster: quadratic drag and command delay 25 ms', dict(M=.01, mode=0, G=1, Fc=.02, Fv=.002, off=0, Fq=1.1e-4, delay=.025, noise=.006),
     [lambda i=i: col(.35+multisine(30, 200, .1, 4, 12, .3, i+2)) for i in range(2)], 200, 200, NM, RAD, 2*np.pi/8192, .008, False,
     {'drive.friction.quadratic': dict(coefficient=1.1e-4), 'drive.delay': dict(delay_s=.025)})
case('chainlift', 'chain lift: friction grows along travel (slope)', cas(40, 3, Fc=60, Fv=50, off=-200, fps=25.),
     [lambda i=i: scurve(40, 500, .8, 1.5, .1, -1.2, 1.2, i+1, .4) for i in range(2)], 200, 500, N, Mm, 1e-5, 4., True,
     {'drive.friction.position': dict(slope_n_per_m=25.)})
case('lugre', 'ball screw: presliding and Stribeck', cas(2.4e-3, 20, Fc=0, Fv=.012, off=.02, dF=.15, dd=.01, Fs=.0),
     [lambda i=i: xva(multisine(30, 1000, .1, 2, 9, .5, i+2)+multisine(30, 1000, .5, 4, 5, .03, i+12), 1000) for i in range(3)], 1000, 1000, NM, RAD, 2*np.pi/2**20, .008, True,
     {'drive.friction.presliding': dict(force_n=.15, distance_m=.01)})
case('zaxis', 'vertical axis with spring balancer and quadratic drag', cas(25, 5, Fc=30, Fv=40, off=-60, kq=110., Fq=90),
     [lambda i=i: scurve(25, 1000, 1.1, 5, .06, -.8, .8, i+1, .2) for i in range(2)], 500, 1000, N, Mm, 5e-6, 3., True,
     {'gantry.stiffness': dict(stiffness_n_per_m=110.), 'drive.friction.quadratic': dict(coefficient=90)})
case('jumpdb', 'H-bridge with minimum voltage (jump dead band), voltage', cas(.0012, 6, G=.06/.9, Gb=.06*.06/.9, Fc=.015, Fv=.0004, off=0, ulim=24, dbu0=.9, dbs=0.),
     [lambda i=i: xva(multisine(25, 1000, .1, 3, 9, 1.5, i+2), 1000) for i in range(2)], 1000, 1000, V, RAD, 2*np.pi/2**16, .05, False,
     {'drive.input_deadband': dict(threshold=.9, lost_fraction=0.)})
case('stoprip', 'linear motor with cogging and a hard stop on one side', cas(6.2, 15, Fc=7, Fv=18, off=0, ripA=5., ripB=2., ripP=.024, esk=6000., eslo=-9., eshi=.19),
     [lambda i=i: scurve(15, 2000, .5, 4, .03, -.2, .2, i+1, .1, (.3, 1), True) for i in range(2)], 2000, 2000, N, MM, 1e-7, 1., True,
     {'drive.ripple.motor': dict(amplitude=np.hypot(5, 2), period_m=.024), 'gantry.endstop': dict(stiffness_n_per_m=6000, high_m=.19)})
case('prbsquad', 'stirrer, PRBS torque steps, quadratic drag (floor from steps)', dict(M=.02, mode=0, G=1, Fc=.2, Fv=.002, off=0, Fq=8e-4, noise=.03),
     [lambda i=i: col(prbs(30, 500, .4, 1.6, i+3, (-1, -.6, .6, 1))) for i in range(2)], 500, 500, NM, RAD, 2*np.pi/40000, .02, True,
     {'drive.friction.quadratic': dict(coefficient=8e-4)})
case('conveyorT', 'conveyor warming up, with belt-splice position friction', cas(38, 5, Fc=30, Fv=60, off=6, thc=-12., thv=0, thT=15., fpA=7., fpB=0, fpL=1.1),
     [lambda i=i: scurve(50, 1000, 1.2, 4, .08, -1.5, 1.5, i) for i in range(2)], 250, 1000, N, Mm, 2e-5, 2., True,
     {'drive.friction.thermal_drift': dict(coulomb_change_n=-12., time_constant_s=15), 'drive.friction.position': dict(amplitude=7., length_m=1.1)})
case('u_twomass', 'elastic coupling, resonance 9 Hz antiresonance, motor encoder', cas(1.2, 6, Fc=2, Fv=4, off=0, tmk=2500., tmc=3., tml=.8),
     [lambda i=i: xva(multisine(20, 1000, .2, 15, 16, .003, i+2), 1000) for i in range(2)], 1000, 1000, N, Mm, 1e-7, .3, True, {'drive.compliance.belt': dict(load_fraction=.4, frequency_hz=8.9)})
case('u_eddy', 'eddy-current brake: drag peaks at 3 rad/s', cas(.1, 5, Fc=.1, Fv=.02, off=0, edb=.4, edv=3.),
     [lambda i=i: scurve(25, 1000, 14, 50, .05, -15, 15, i+1, .2, (.1, 1)) for i in range(3)], 500, 1000, NM, RAD, 2*np.pi/2**17, .03, True, {'UNKNOWN': dict(what='0.4 v/(1+(v/3)^2)')})
case('u_ksat', 'torque constant falls with current (iron saturation)', cas(.02, 8, G=.4, Fc=.1, Fv=.02, off=0, ksat=20., noise=.01),
     [lambda i=i: xva(multisine(20, 1000, .4, 6, 12, .12, i+2), 1000) for i in range(2)], 1000, 1000, A, RAD, 2*np.pi/2**17, .03, False, {'UNKNOWN': dict(what='i/(1+|i|/20 A)')})
case('u_hyst', 'hysteretic spring (flexible hose): spring and slow Dahl loop', cas(3., 8, Fc=1., Fv=5, off=0, kq=30., dF=7., dd=.05),
     [lambda i=i: xva(multisine(30, 500, .08, 1.5, 10, .1, i+2), 500) for i in range(2)], 500, 500, N, Mm, 1e-6, .4, True, {'UNKNOWN': dict(what='hysteresis loop 7 N over 50 mm + 30 N/m; stiffness + presliding acceptable')})
case('u_drift', 'constant force drifts 0.15 N/s (air spring leaking)', cas(9., 8, Fc=10, Fv=20, off=3, drift=.15),
     [lambda i=i: scurve(40, 500, .6, 4, .05, -.4, .4, i+1, .2) for i in range(2)], 500, 500, N, MM, 1e-6, .8, True, {'UNKNOWN': dict(what='offset + 0.15 N/s * t')})
case('u_dwell', 'breakaway force grows with rest time', cas(9., 8, Fc=10, Fv=20, off=3, dwk=14., dwt=1.),
     [lambda i=i: scurve(40, 500, .3, 3, .05, -.1, .1, i+1, 1.5) for i in range(2)], 500, 500, N, MM, 1e-7, .4, True, {'UNKNOWN': dict(what='stiction +14 N (1-exp(-rest/1 s)), fades over 2 mm')})
B2 = [n for n in CASES if n not in B1]
# ---------------- experiments 2
variant('x_chirp_nonoise', 'null2_chirp5k', p=dict(noise=0.))
variant('x_chirp_fc20k', 'null2_chirp5k', fc=20000, refs=[lambda i=i: xva(chirp(10, 20000, .5+.2*i, 60, .03, 1.3), 20000) for i in range(2)])
variant('x_chirp_meas', 'null2_chirp5k', measured=True)
variant('x_sag_strong', 'sag', p=dict(sagk=.003, noise=.006), unoise=.006, effects={'drive.supply_sag': dict(fraction_per_w=.003, time_constant_s=.02)})
variant('x_fandelay_bi', 'fandelay', refs=[lambda i=i: col(multisine(30, 200, .1, 4, 12, .4, i+2)) for i in range(3)])
variant('x_agv_fc', 'agv', p=dict(Fc=.2))
variant('x_dwell_long', 'u_dwell', p=dict(dwk=25.))
def _null(i):
    rng = np.random.default_rng(1000+i); fs = int(rng.choice([100, 200, 500, 1000, 2000])); kind = ('N', 'A', 'V')[i % 3]
    M = 10**rng.uniform(-1, 1); T = 20 if fs > 500 else 30; fc = max(1000, fs); R = .2*10**rng.uniform(-.3, .5); vm = R*rng.uniform(2, 5)
    am = vm*rng.uniform(5, 12); Fc = M*am*rng.uniform(.05, .4); Fv = M*am/vm*rng.uniform(.02, .5); off = Fc*rng.uniform(-.8, .8)
    G, Gb, iu = dict(N=(1., 0., N), A=(3.3, 0., A), V=(2.2, 2.2*2.2, V))[kind]; meas = bool(rng.integers(2)); ex = rng.integers(4); ns = int(rng.integers(2, 4))
    un = M*am/G*.01; p = cas(M, min(10, fs/40), G=G, Gb=Gb, Fc=Fc, Fv=Fv, off=off, noise=0 if meas else .5*un*G)
    f1 = min(vm/R*1.2, fs/60.)
    def ref(k):
        if ex == 0: return scurve(T, fc, vm, am, .06, -R, R, 10*i+k, .2, (.2, 1))
        if ex == 1: return xva(multisine(T, fc, f1/15, f1, 9, R*.4, 10*i+k), fc)
        if ex == 2: x = steps(T, fc, R*.6, 1.2, 10*i+k); return np.c_[x, 0*x, 0*x]
        return xva(chirp(T, fc, f1/20*(1+.3*k), f1*1.5, R, 1.), fc)
    if ex == 2: p['Mff'] = 0; p['ulim'] = 3*M*am/G
    case(f'rn{i}', f'random null {kind} fs {fs} exc {("scurve","multisine","steps","chirp")[ex]} {"measured" if meas else "commanded"} Fc/Ma {Fc/M/am:.2f}', p,
         [lambda k=k: ref(k) for k in range(ns)], fs, fc, iu, Mm, R*2e-6, un, meas, {}, note='random null')
def _vnull(i):
    rng = np.random.default_rng(2000+i); fs = int(rng.choice([100, 250, 500, 1000])); M = 4.; T = 30; R = .3; vm = rng.uniform(.3, .8); Tv = 10**rng.uniform(-2.2, -1.2)
    Kp = M/Tv; Fc = Kp*vm*rng.uniform(.02, .3); ex = i % 2
    def ref(k): return col(scurve(T, 1000, vm, vm*8, .05, -R, R, 10*i+k, .3)[:, 1] if ex else multisine(T, 1000, .1, 2, 9, vm*.5, 10*i+k))
    case(f'rv{i}', f'random null velocity setpoint fs {fs} {"scurve" if ex else "multisine"} T {Tv*1e3:.0f} ms C/vmax {Fc/Kp/vm:.2f}',
         dict(M=M, mode=2, vKp=Kp, vKi=Kp*rng.uniform(2, 15), Fc=Fc, Fv=Kp*rng.uniform(.02, .2), off=0.), [lambda k=k: ref(k) for k in range(2)], fs, 1000,
         ('m/s', 1.), Mm, 1e-6, .003*vm, False, {}, note='random null')
for i in range(24): _null(i)
for i in range(10): _vnull(i)
variant('x_rn17_avg', 'rn17', avgu=True)
variant('x_chirp_avg', 'null2_chirp5k', avgu=True)
variant('x_rn18_500', 'rn18', fs=500)
variant('x_rn18_noise5', 'rn18', unoise=CASES['rn18']['unoise']*5)
variant('x_rn18_Fc0', 'rn18', p=dict(Fc=0.))
variant('x_rn18_lowFc', 'rn18', p=dict(Fc=CASES['rn18']['p']['Fc']*.3))
variant('x_rn18_noKi', 'rn18', p=dict(Ki=0.))
variant('x_slew_avg', 'slew', avgu=True)
for k, f in enumerate((.1, 4.)): variant(f'x_rn18_lsb{k}', 'rn18', lsb=CASES['rn18']['lsb']*f)
variant('x_rn18_n01', 'rn18', unoise=CASES['rn18']['unoise']*.1)
variant('x_rn18_smooth', 'rn18', refs=[lambda k=k: xva(np.convolve(steps(20, 2000, .25, 1.2, 180+k), np.hanning(202)[1:-1]/np.hanning(202).sum(), 'same'), 2000) for k in range(2)])
EFF = dict(quad=('drive.friction.quadratic', lambda s, b: dict(Fq=s*b['F']/b['vm']**2), lambda p, b: dict(coefficient_n_s2_per_m2=p['Fq']/b['G'])),
 asym=('drive.friction.asymmetric', lambda s, b: dict(asv=s*b['F']/b['vm']), lambda p, b: dict(viscous_difference_n_s_per_m=p['asv']/b['G'])),
 stri=('drive.friction.stribeck', lambda s, b: dict(Fs=s*b['F'], vs=.12*b['vm'], sdel=2), lambda p, b: dict(force_n=p['Fs']/b['G'], velocity_m_per_s=p['vs'], exponent=2)),
 load=('drive.friction.load', lambda s, b: dict(Kl=min(s, .5)), lambda p, b: dict(coefficient=p['Kl'])),
 posf=('drive.friction.position', lambda s, b: dict(fpA=min(s*b['F'], .9*b['Fc']), fpL=.8*b['R']), lambda p, b: dict(amplitude=p['fpA']/b['G'], length_m=p['fpL'])),
 ther=('drive.friction.thermal_drift', lambda s, b: dict(thc=-min(s*b['F'], .8*b['Fc']), thT=9.), lambda p, b: dict(coulomb_change_n=p['thc']/b['G'], time_constant_s=9.)),
 ripp=('drive.ripple.motor', lambda s, b: dict(ripA=s*b['F'], ripB=.5*s*b['F'], ripP=.17*b['R']), lambda p, b: dict(amplitude=np.hypot(p['ripA'], p['ripB'])/b['G'], period_m=p['ripP'])),
 mpos=('gantry.mass_position', lambda s, b: dict(m1=s*b['M']/b['R']), lambda p, b: dict(slope_kg_per_m=p['m1']/b['G'])),
 spri=('gantry.stiffness', lambda s, b: dict(kq=s*b['F']/b['R']), lambda p, b: dict(stiffness_n_per_m=p['kq']/b['G'])),
 stop=('gantry.endstop', lambda s, b: dict(esk=s*b['F']/b['R']*10, eslo=-.75*b['R'], eshi=.75*b['R']), lambda p, b: dict(stiffness_n_per_m=p['esk']/b['G'])),
 dela=('drive.delay', lambda s, b: dict(delay=s*.02), lambda p, b: dict(delay_s=p['delay']+.5/b['fc'])),
 lag=('drive.lag1|drive.current_loop', lambda s, b: dict(lag=s*.02), lambda p, b: dict(time_constant_s=p['lag'])),
 pres=('drive.friction.presliding', lambda s, b: dict(dF=b['Fc'], dd=s*.1*b['R'], Fc=0.), lambda p, b: dict(force_n=p['dF']/b['G'], distance_m=p['dd'])))
def _pos(i):
    rng = np.random.default_rng(5000+i); names = list(EFF); e1 = names[i % len(names)]; two = i >= 26
    es = [e1] + ([names[(i*5+3) % len(names)]] if two else [])
    if len(set(es)) < len(es) or {'dela', 'lag'} == set(es): es = es[:1]
    fs = int(rng.choice([200, 500, 1000, 2000])); kind = ('N', 'A')[i % 2]
    M = 10**rng.uniform(-1, 1); T = 20 if fs > 500 else 30; fc = max(1000, fs); R = .2*10**rng.uniform(-.3, .5); vm = R*rng.uniform(2, 4)
    am = vm*rng.uniform(5, 10); Fc = M*am*rng.uniform(.08, .3); Fv = M*am/vm*rng.uniform(.05, .4); G, iu = dict(N=(1., N), A=(3.3, A))[kind]
    meas = not ({'dela', 'lag'} & set(es)); un = M*am/G*.008; f1 = min(vm/R, fs/80.); ex = 0 if {'stri', 'posf', 'ripp', 'stop'} & set(es) else i % 2
    p0 = cas(M, min(4 if not meas else 8, fs/40), G=G, Fc=Fc, Fv=Fv, off=.3*Fc, noise=0 if meas else .5*un*G); b = dict(F=M*am, vm=vm, R=R, M=M, Fc=Fc, G=G, fc=fc)
    def ref(k): return (scurve(T, fc, vm, am, .06, -R, R, 10*i+k, .15, (.15, 1)) if ex == 0 else xva(multisine(T, fc, f1/15, f1, 9, R*.4, 10*i+k), fc))
    target = rng.uniform(4, 15); p = dict(p0); eff = {}
    for e in es:
        nm, fp, ft = EFF[e]; s = .1
        for _ in range(4):
            q = {**p0, **fp(s, b)}; c = dict(p=q, refs=[lambda: ref(0)], fs=fs, fc=fc, measured=meas, lsb=R*1e-6, unoise=un)
            try: v = simulate(c, 0)[3]['visible']/np.hypot(un, q['noise']/G)
            except SystemExit: v = 100*target
            s *= min(max(target/max(v, 1e-3), .1), 8)
        q = fp(s, b); p.update(q); eff[nm] = ft({**p0, **q}, b)
    case(f'rp{i}', f'random {kind} fs {fs} {("scurve","multisine")[ex]} {"+".join(es)}', p, [lambda k=k: ref(k) for k in range(2+i % 2)], fs, fc, iu, Mm, R*1e-6, un, meas, eff)
import sys as _s
if any('rp' in x for x in _s.argv):
    for i in range(46):
        if f'rp{i}' in _s.argv: _pos(i)
variant('x_smooth_500', 'x_rn18_smooth', fs=500)
variant('x_smooth_nosat', 'x_rn18_smooth', p=dict(ulim=1e9))
variant('x_smooth_slow', 'x_rn18_smooth', refs=[lambda k=k: xva(np.convolve(steps(20, 2000, .25, 1.2, 180+k), np.hanning(802)[1:-1]/np.hanning(802).sum(), 'same'), 2000) for k in range(2)])
variant('x_smooth_Fc0', 'x_rn18_smooth', p=dict(Fc=0.))
variant('x_smooth_noise5', 'x_rn18_smooth', unoise=5*CASES['rn18']['unoise'])
variant('x_slow_lsb', 'x_smooth_slow', lsb=CASES['rn18']['lsb']*.01)
variant('x_slow_noKi', 'x_smooth_slow', p=dict(Ki=0.))
variant('x_slow_1k', 'x_smooth_slow', fs=1000)
