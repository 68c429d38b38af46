# (case, machine, parameter changes, camera changes, options, truth list[(effect names acceptable, where, text)])
def add(**k): return {a:('+',b) for a,b in k.items()}
def mul(**k): return {a:('*',b) for a,b in k.items()}
def setv(**k): return {a:('=',b) for a,b in k.items()}
def fr(s): return mul(fcx=s,fsx=s,fvx=s,fcy=s,fsy=s,fvy=s,fma=s,fmb=s,fva=s,fvb=s)
BOTH=lambda **k: k
C=[]
def case(name,m,P={},cam={},speed=1.0,push=None,truth=[]): C.append(dict(case=name,machine=m,P=P,cam=cam,speed=speed,push=push,truth=truth))
# bases
for m in('m1','m2','m3'): case(m+'-base',m)
# unchanged
case('m1-null-course','m1'); case('m2-null-faster','m2',speed=1.12); case('m3-null-slower','m3',speed=.6)
case('m1-null-push','m1',push=(14.,.3,15.,6.)); case('m2-null-temp','m2',P=fr(1.017)); case('m3-null-temp','m3',P=fr(.983))
case('m1-null-slower','m1',speed=.65); case('m2-null-push','m2',push=(21.,.35,-8.,20.)); case('m3-null-course','m3')
def t(*a): return a
S={}
S['m1']=[
 ('coulomb-x',add(fcx=1.2,fsx=1.2),{},[t('drive.friction.coulomb','x','+1.2 N')]),
 ('delay',add(delay_a=.015,delay_b=.015),{},[t('drive.delay','a+b','+0.015 s')]),
 ('slew',setv(slew=4),{},[t('drive.saturation.slew','a+b','4 m/s2')]),
 ('mass',add(mx=.5,my=.5),{},[t('gantry.inertia','x+y','+0.5 kg in x and y')]),
 ('gain-a',setv(gain_a=.95),{},[t('drive.gain','a','0.95')]),
 ('belt-soft',setv(kb_a=8e3,kb_b=8e3),{},[t('drive.compliance.belt','a+b','2.4e-5 to 1.25e-4 m/N')]),
 ('tilt-x',add(tiltx=.6),{},[t('gantry.tilt','x','+0.6 N')]),
 ('camera-latency',{},add(lat=.010),[t('sensor.camera_latency','all','+0.010 s')]),
 ('magnet-weak',mul(km=.45),{},[t('coupling.magnet_spring','all','stiffness 160 to 72 N/m')]),
 ('squareness',{},add(square=.008),[t('gantry.squareness','all','+0.008 rad')]),
 ('position-friction',setv(posfr=.5,posL=.12),{},[t('drive.friction.position','x+y','+-50 % of Coulomb, 0.12 m')]),
 ('noise',{},mul(noise=2.5),[t('sensor.noise_model','all','ratio 2.5')]),
]
S['m2']=[
 ('viscous',add(fvx=10,fvy=10),{},[t('drive.friction.viscous','x+y','+10 N s/m')]),
 ('speed-limit',setv(vmax=.30),{},[t('drive.saturation.speed','a+b','0.30 m/s')]),
 ('backlash',setv(gap_a=.0004,gap_b=.0004),{},[t('drive.backlash','a+b','0.0004 m')]),
 ('ripple-a',setv(cog_a=1.3),{},[t('drive.ripple.motor','a','0.3 to 1.3 N, period 1.667 mm')]),
 ('camera-scale',{},mul(scale=1.012),[t('sensor.camera_scale_rotation','all','scale x1.012')]),
 ('striker-friction',setv(fst=.5),{},[t('coupling.striker_friction','all','0.22 to 0.50 N')]),
 ('lost-frames',{},setv(drop=.06),[t('sensor.frame_drop','all','0.006 to 0.06')]),
 ('stribeck-y',add(fsy=2.0),{},[t('drive.friction.stribeck','y','excess 0.4 to 2.4 N, 0.02 m/s')]),
 ('gain-both',setv(gain_a=1.05,gain_b=1.05),{},[t('drive.gain','a+b','1.05')]),
 ('delay',add(delay_a=.020,delay_b=.020),{},[t('drive.delay','a+b','+0.020 s')]),
 ('quadratic',add(fqx=20,fqy=20),{},[t('drive.friction.quadratic','x+y','20 N s2/m2')]),
 ('frame-jitter',{},setv(stampjit=.002),[t('sensor.frame_jitter','all','0.1 to 2 ms')]),
]
S['m3']=[
 ('coulomb-y',add(fcy=1.0,fsy=1.0),{},[t('drive.friction.coulomb','y','+1.0 N')]),
 ('torque-limit',setv(tlim_a=8,tlim_b=8),{},[t('drive.saturation.torque_speed','a+b','8 N per motor')]),
 ('camera-rotation',{},add(rot=.015),[t('sensor.camera_scale_rotation','all','rotation +0.015 rad')]),
 ('lag',setv(lag=.008),{},[t('drive.lag1','a+b','0.008 s')]),
 ('deadband',setv(dead=.03),{},[t('drive.input_deadband','a+b','0.03 m/s')]),
 ('eccentricity-a',setv(ecc_a=.00012),{},[t('sensor.encoder_eccentricity','a','0.12 mm')]),
 ('mass',add(mx=.4,my=.4),{},[t('gantry.inertia','x+y','+0.4 kg in x and y')]),
 ('belt-a-soft',setv(kb_a=5e3),{},[t('drive.compliance.belt','a','3.3e-5 to 2e-4 m/N')]),
 ('thermal',setv(therm=-.4,thermT=15),{},[t('drive.friction.thermal_drift','x+y','-40 % with 15 s')]),
 ('cross-damping',setv(xcd=4),{},[t('gantry.cross_coupling','x+y','4 N s/m')]),
 ('asymmetric-x',setv(asx=.35),{},[t('drive.friction.asymmetric','x','+-35 % of Coulomb: difference 1.12 N')]),
 ('clock-skew',{},setv(skew=3e-4),[t('sensor.clock_skew','all','3e-4')]),
]
Dd={
'm1':[('2-delay-coulomb-y',{**add(delay_a=.012,delay_b=.012),**add(fcy=1.3,fsy=1.3)},{},[t('drive.delay','a+b','+0.012 s'),t('drive.friction.coulomb','y','+1.3 N')]),
 ('2-mass-latency',add(mx=.5,my=.5),add(lat=.009),[t('gantry.inertia','x+y','+0.5 kg'),t('sensor.camera_latency','all','+0.009 s')]),
 ('2-belt-magnet',{**setv(kb_a=8e3,kb_b=8e3),**mul(km=.5)},{},[t('drive.compliance.belt','a+b','1.25e-4 m/N'),t('coupling.magnet_spring','all','160 to 80 N/m')])],
'm2':[('2-speed-viscous',{**setv(vmax=.3),**add(fvx=10,fvy=10)},{},[t('drive.saturation.speed','a+b','0.3 m/s'),t('drive.friction.viscous','x+y','+10')]),
 ('2-gainb-rotation',setv(gain_b=.95),add(rot=.012),[t('drive.gain','b','0.95'),t('sensor.camera_scale_rotation','all','rotation +0.012')]),
 ('2-striker-delay',{**setv(fst=.45),**add(delay_a=.012,delay_b=.012)},{},[t('coupling.striker_friction','all','0.22 to 0.45 N'),t('drive.delay','a+b','+0.012 s')])],
'm3':[('2-coulomb-x-scale',add(fcx=1.0,fsx=1.0),mul(scale=1.012),[t('drive.friction.coulomb','x','+1.0 N'),t('sensor.camera_scale_rotation','all','scale x1.012')]),
 ('2-slew-frames',setv(slew=4),setv(drop=.06),[t('drive.saturation.slew','a+b','4'),t('sensor.frame_drop','all','0.06')]),
 ('2-mass-tilt-y',{**add(mx=.4,my=.4),**add(tilty=.6)},{},[t('gantry.inertia','x+y','+0.4'),t('gantry.tilt','y','+0.6 N')])]}
order=[]
di={m:0 for m in Dd}
for k in range(12):
    for m in('m1','m2','m3'): n,P,c,tr=S[m][k]; case(f'{m}-{n}',m,P,c,truth=tr)
    if k%3==2 and k<9:
        for m in('m1','m2','m3'): n,P,c,tr=Dd[m][k//3]; case(f'{m}-{n}',m,P,c,truth=tr)
