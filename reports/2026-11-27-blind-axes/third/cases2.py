from cases import *
import cases
AX.clear(); C.clear()
cases.BASE.clear()
B=cases.BASE
ax("B1","flexure voice coil, force mN, 2 kHz, M=0.02 kg K=200 N/m B=0.3 Ns/m Fc=8 mN, 20 nm, force noise 5 mN, chirps",
 "fs=2000 T=10 M=0.02 K=200 B=0.3 Fc=0.008 c=3 amp=0.35 f0=0.5 f1=40 hold=5 spd=0 yq=2e-8 yn=1e-8 un=0.002 ufac=1000 yfac=1e6","--time t --input u:mN --position y:um")
ax("B2","DC motor with disc, voltage mV, 100 Hz, M=0.05 V s2/rad ke=0.05 B=0.01 Fc=0.3 V, 2048/turn in deg, step ladder/random steps",
 "fs=100 T=60 sub=50 mode=1 M=0.05 ke=0.05 B=0.01 Fc=0.3 te=0.001 c=4 amp=3 spd=0.9 hold=0.8 yq=0.003068 uq=0.01 ufac=1000 yfac=57.29577951","--time t --input u:mV --position y:deg")
ax("B3","crane slewing gear, velocity setpoint rpm, 50 Hz, PI loop T=0.5 s rho=0.4, B=0.1 Fc=0.01 rad/s, 0.05 mrad",
 "fs=50 T=150 sub=40 mode=2 M=0.5 B=0.1 Fc=0.01 rho=0.4 c=5 amp=0.25 hold=3.3 yq=5e-5 ufac=9.549296586 yfac=0.159154943","--time t --input u:rpm --position y:turns")
ax("B4","pneumatic piston, velocity setpoint cm/s, 100 Hz, P loop T=0.15 s, B=0.3 Fc=0.02 m/s, 10 um, PRBS of several levels with centring",
 "fs=100 T=60 sub=40 mode=2 M=0.15 B=0.3 Fc=0.02 c=4 amp=0.35 spd=0.85 hold=0.6 cl=3 Kp=0.6 yq=1e-5 ufac=100 yfac=100","--time t --input u:cm/s --position y:cm")
ax("B5","telescope mount, torque Nm, 200 Hz, J=40 B=15 Fc=2 Nm, 1 urad encoder, slow moves, torque noise 0.1 Nm",
 "fs=200 T=60 sub=20 M=40 B=15 Fc=2 c=1 amp=0.3 spd=0.15 acc=0.2 hold=0.5 cl=1 Kp=1580 Kd=400 Mff=40 tf=0.02 yq=1e-6 un=0.08 dis=0.08 yfac=1000","--time t --input u:Nm --position y:mrad")
ax("B6","tilt head with gravity, current A, 100 Hz, M=0.02 A s2/rad B=0.03 Fc=0.05 gA=0.6 gB=0.2 A, 8192 counts, current noise 10 mA",
 "fs=100 T=60 sub=40 M=0.02 B=0.03 Fc=0.05 gA=0.6 gB=0.2 c=1 amp=0.9 spd=2 acc=10 hold=0.3 cl=1 Kp=3.2 Kd=0.35 Mff=0.02 tf=0.01 yq=7.67e-4 un=0.01 yfac=1303.797","--time t --input u:A --position y:counts --counts-per-turn 8192")
ax("B7","CNC axis, velocity setpoint mm/min, 500 Hz, PI loop T=0.012 s rho=8, B=0.05 Fc=2 mm/s, 1 um, trapezoids",
 "fs=500 T=24 mode=2 M=0.012 B=0.05 Fc=0.002 rho=8 c=1 amp=0.15 spd=0.3 acc=3 hold=0.2 cl=2 Kp=4 yq=1e-6 ufac=60000 yfac=1000","--time t --input u:mm/min --position y:mm")
ax("B8","roller dyno, torque Nm, 100 Hz, J=3 Fc=2 B=0.05 quadratic drag 0.01, 3600/turn in turns, torque noise 0.4 Nm",
 "fs=100 T=70 sub=20 M=3 Fc=2 B=0.05 bq=0.01 c=2 amp=60 f0=0.05 f1=0.6 spd=1.2 cl=1 Kp=9 Kd=8 Mff=3 yq=0.0017453 un=0.4 yfac=0.159154943","--time t --input u:Nm --position y:turns")
ax("B9","linear motor in a fast velocity loop, mm/s, 4 kHz, T=2 ms, B=0.03 Fc=0.5 mm/s, 20 nm, multisine",
 "fs=4000 T=8 sub=10 mode=2 M=0.002 B=0.03 Fc=0.0005 c=2 amp=0.03 f0=1 f1=80 spd=0.3 yq=2e-8 un=0.00005 ufac=1000 yfac=1e6","--time t --input u:mm/s --position y:um")
ax("B10","elastic joint (load 55 %, 6 Hz antiresonance), torque Nm, 1 kHz, J=0.5 B=1 Fc=0.8, 20 urad, torque noise 0.05 Nm",
 "fs=1000 T=16 M=0.5 B=1 Fc=0.8 lf=0.55 cf=6 cz=0.05 c=1 amp=0.8 spd=2 acc=12 hold=0.2 cl=1 Kp=120 Kd=14 Mff=0.5 tf=0.003 yq=2e-5 un=0.05 yfac=57.29577951","--time t --input u:Nm --position y:deg")
ax("B11","servo press, force kN, 250 Hz, M=800 kg B=2000 Fc=300 N, 2 um encoder, position in inch, force noise 10 N",
 "fs=250 T=40 M=800 B=2000 Fc=300 c=6 amp=0.12 hold=0.5 f0=1.2 cl=1 Kp=130000 Kd=14000 Mff=800 tf=0.006 yq=2e-6 un=10 dis=8 ufac=0.001 yfac=39.37007874","--time t --input u:kN --position y:in")
ax("B12","yaw frame with slow motors (lag 50 ms) and quadratic drag, torque mNm, 200 Hz, J=0.03 Fc=1 mNm bq=0.01, 0.5 mrad noise",
 "fs=200 T=40 M=0.03 B=0.005 Fc=0.001 bq=0.01 te=0.05 c=6 amp=1.5 hold=0.8 f0=0.6 cl=1 Kp=0.35 Kd=0.16 tf=0.01 yn=2e-4 un=0.0005 ufac=1000 yfac=1000","--time t --input u:mNm --position y:mrad")
LAG="drive.current_loop|drive.lag1"
B.update({"B1":["gantry.stiffness"],"B6":["gantry.gravity"],"B8":["drive.friction.quadratic"],"B10":["drive.compliance.belt"],"B12":["drive.friction.quadratic",LAG]})
for a in AX: c(a,"ref","reference","",B.get(a,[]))
N="null"
NC={"B1":("amp=0.25","c=6 amp=0.3 hold=0.05 f0=8"),"B2":("amp=4 hold=0.5","c=6 amp=4 hold=1 f0=0.8"),"B3":("c=4 amp=0.22 hold=2.5 spd=0.9","c=6 amp=0.3 hold=2 f0=0.3"),
"B4":("amp=0.25 hold=0.4","c=2 amp=0.3 f0=0.1 f1=3 spd=0.5"),"B5":("amp=0.2 spd=0.1","c=2 amp=0.12 f0=0.03 f1=0.5 spd=1"),"B6":("amp=0.6 spd=1.4","c=2 amp=0.5 f0=0.1 f1=1.5 spd=1"),
"B7":("amp=0.1 spd=0.2 acc=2","amp=0.2 spd=0.4 acc=5"),"B8":("amp=40","c=1 amp=60 spd=30 acc=15 hold=1"),"B9":("amp=0.02","c=6 amp=0.05 hold=0.02 f0=30"),
"B10":("amp=0.6 spd=1.5 acc=9","c=2 amp=0.3 f0=0.3 f1=6 spd=1"),"B11":("amp=0.08","c=1 amp=0.12 spd=0.35 acc=2 hold=0.2"),"B12":("amp=1.0","c=1 amp=1.2 spd=1.5 acc=4 hold=0.5")}
for a,(x,y) in NC.items(): c(a,"null1",N,"",[],course=x); c(a,"null2",N,"",[],course=y)
s="single"
def s_(a,n,m,acc,par=None,course=""): c(a,n,s,m,acc,par,course)
s_("B1","delay","delay=0.0015",["drive.delay"],{"delay_s":0.0015}); s_("B1","ripple","drA=0.03 drP=0.0004",["drive.ripple.motor"],{"period_m":0.0004}); s_("B1","presliding","dFc=0.04 pre=2e-4",["drive.friction.presliding"],{"force_n":0.048,"distance_m":2e-4})
s_("B2","deadband","db=0.6 dbs=0",["drive.input_deadband"],{"threshold":0.6},"c=6 amp=4 hold=0.7 f0=0.9"); s_("B2","quadratic","bq=0.004",["drive.friction.quadratic"],{"coefficient_n_s2_per_m2":0.004}); s_("B2","torquespeed","tsF=3 tsv=30",["drive.saturation.torque_speed"],{"force_n":3,"speed_m_per_s":30})
s_("B3","quadratic","bq=1.2",["drive.friction.quadratic"],{"coefficient_n_s2_per_m2":1.2}); s_("B3","sat","sat=0.18",["drive.saturation.speed"],{"limit_m_per_s":0.18}); s_("B3","loopgain","dM=0.2",[R+"time_constant"],{})
s_("B4","asym","adv=0.5",["drive.friction.asymmetric"],{"viscous_difference_n_s_per_m":0.5}); s_("B4","delay","delay=0.07",["drive.delay"],{"delay_s":0.07}); s_("B4","stribeck","Fs=0.06 vs=0.05",["drive.friction.stribeck"],{"force_n":0.06,"velocity_m_per_s":0.05}); s_("B4","gain","gain=0.85",["drive.gain",R+"viscous"],{"gain":0.85})
s_("B5","posfriction","pA=1.2 pL=0.15",["drive.friction.position"],{"sine_n":1.2,"length_m":0.15}); s_("B5","stribeck","Fs=1.5 vs=0.02",["drive.friction.stribeck"],{"force_n":1.5,"velocity_m_per_s":0.02}); s_("B5","presliding","pre=0.003",["drive.friction.presliding"],{"force_n":2,"distance_m":0.003})
s_("B6","load","Kl=0.25",["drive.friction.load"],{"coefficient":0.25}); s_("B6","payload","dgA=0.2 dM=0.006",[R+"gravity+inertia"]); s_("B6","sat","sat=0.6",["drive.saturation.speed"],{"limit_m_per_s":0.6})
s_("B7","delay","delay=0.012",["drive.delay"],{"delay_s":0.012}); s_("B7","slew","slew=1.5",["drive.saturation.slew"],{"limit_m_per_s2":1.5}); s_("B7","ripple","drA=0.012 drP=0.01",["drive.ripple.motor"],{"period_m":0.01}); s_("B7","scale","sc=1.08",["UNEXPLAINED","drive.gain",R+"any"])
s_("B8","thermal","dFc=10 th=-10 thT=20",["drive.friction.thermal_drift"],{"time_constant_s":20}); s_("B8","asymdrag","adv=0.4",["drive.friction.asymmetric"],{"viscous_difference_n_s_per_m":0.4}); s_("B8","gravity","dgA=12",["gantry.gravity","drive.ripple.motor"],{"sine_n":12})
s_("B9","lag","lag=0.002",["drive.lag1"],{"time_constant_s":0.002}); s_("B9","compliance","encl=1 lf=0.5 cf=60 cz=0.1",["drive.compliance.belt"]); s_("B9","coulomb","dFc=0.003",[R+"coulomb"])
s_("B10","endstop","es=60 eh=0.6 el=-0.6",["gantry.endstop"],{"stiffness_n_per_m":60}); s_("B10","gravity","dgA=4",["gantry.gravity"],{"sine_n":4}); s_("B10","softer","cf=4.5",[R+"frequency"])
s_("B11","spring","dK=6000",["gantry.stiffness"],{"stiffness_n_per_m":6000}); s_("B11","delay","delay=0.01",["drive.delay"],{"delay_s":0.01}); s_("B11","tilt","dtilt=250",["gantry.tilt","drive.offset",R+"offset"],{"force_n":250}); s_("B11","lostcounts","lost=0.3 lostn=0.002",["UNEXPLAINED","NONE"])
s_("B12","unbalance","dgA=0.02 dgB=0.01",["gantry.gravity"],{"sine_n":0.02,"cosine_n":0.01}); s_("B12","jitter","jit=0.001",["UNEXPLAINED","NONE"]); s_("B12","faultlag","te=0.09",[R+"time_constant"])
d="double"
def d_(a,n,m,acc,par=None,course=""): c(a,n,d,m,acc,par,course)
d_("B1","stiff+coulomb","dK=60 dFc=0.03",[R+"stiffness",R+"coulomb"]); d_("B2","quadratic+delay","bq=0.004 delay=0.03",["drive.friction.quadratic","drive.delay"],{"coefficient_n_s2_per_m2":0.004,"delay_s":0.03})
d_("B4","quadratic+delay","bq=1.0 delay=0.07",["drive.friction.quadratic","drive.delay"],{"coefficient_n_s2_per_m2":1.0,"delay_s":0.07}); d_("B5","ripple+load","drA=1.2 drP=0.05 Kl=0.2",["drive.ripple.motor","drive.friction.load"],{"period_m":0.05,"coefficient":0.2})
d_("B6","stribeck+delay","Fs=0.12 vs=0.15 delay=0.03",["drive.friction.stribeck","drive.delay"],{"force_n":0.12,"delay_s":0.03}); d_("B7","ripple+delay","drA=0.012 drP=0.01 delay=0.012",["drive.ripple.motor","drive.delay"],{"period_m":0.01,"delay_s":0.012})
d_("B8","delay+asym","delay=0.06 adv=0.4",["drive.delay","drive.friction.asymmetric"],{"delay_s":0.06,"viscous_difference_n_s_per_m":0.4}); d_("B9","ripple+delay","drA=0.002 drP=0.0006 delay=0.001",["drive.ripple.motor","drive.delay"],{"period_m":0.0006,"delay_s":0.001})
d_("B10","delay+load","delay=0.006 Kl=0.12",["drive.delay","drive.friction.load"],{"delay_s":0.006,"coefficient":0.12}); d_("B11","endstop+inertia","es=40000 eh=0.05 el=-0.055 dM=150",["gantry.endstop",R+"inertia"],{"stiffness_n_per_m":40000}); d_("B12","asym+delay","adv=0.02 delay=0.04",["drive.friction.asymmetric","drive.delay"],{"viscous_difference_n_s_per_m":0.02,"delay_s":0.04}); d_("B3","delay+sat","delay=0.4 sat=0.18",["drive.delay","drive.saturation.speed"],{"delay_s":0.4,"limit_m_per_s":0.18})
