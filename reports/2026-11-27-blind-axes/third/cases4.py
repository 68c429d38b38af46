import cases
A=dict(cases.AX)
import cases2
from cases import AX,C,ax,c,R
for k,v in A.items(): AX.setdefault(k,v)
C.clear()
LAG="drive.current_loop|drive.lag1"
N="null";s="single";d="double"
def S(a,n,m,acc,par=None,course="",kind=s): c(a,n,kind,m,acc,par,course)
ax("D1","wafer stage, force N, 2 kHz, M=12 kg B=6 Fc=1.5 N, 2 nm interferometer, force noise 0.1 N, trapezoids 60 mm",
 "fs=2000 T=10 M=12 B=6 Fc=1.5 c=1 amp=0.03 spd=0.15 acc=4 hold=0.1 cl=1 Kp=47000 Kd=1050 Mff=12 tf=0.001 yq=2e-9 yn=5e-9 un=0.1 yfac=1e6","--time t --input u:N --position y:um")
ax("D2","brushed motor wheel on voltage, 500 Hz, M=0.4 V s2/rad B=0.1 ke=2.2 Fc=1.5 V te=3 ms, 2000 counts/turn, ladder, V",
 "fs=500 T=24 sub=20 mode=1 M=0.4 B=0.1 ke=2.2 Fc=1.5 te=0.003 c=6 amp=20 hold=0.4 f0=1.5 yq=0.00314159 uq=0.02 yfac=0.159154943","--time t --input u:V --position y:turns")
ax("D3","excavator boom cylinder, velocity setpoint m/min, 100 Hz, P loop T=0.12 s valve lag 40 ms, B=0.25 Fc=10 mm/s, 0.1 mm",
 "fs=100 T=80 sub=40 mode=2 M=0.12 te=0.04 B=0.25 Fc=0.01 c=6 amp=0.25 hold=1.2 f0=0.6 cl=3 Kp=0.3 yq=1e-4 ufac=60 yfac=1000","--time t --input u:m/min --position y:mm")
ax("D4","shoulder exo, torque Nm, 200 Hz, J=2 B=3 Fc=1.2 gA=25 Nm (q from vertical), 0.1 mrad, torque noise 0.3 Nm, range +-60 deg",
 "fs=200 T=40 sub=20 M=2 B=3 Fc=1.2 gA=25 c=1 amp=1.0 spd=1.5 acc=6 hold=0.3 cl=1 Kp=700 Kd=60 Mff=2 tf=0.01 yq=1e-4 un=0.3 yfac=57.29577951","--time t --input u:Nm --position y:deg")
ax("D5","rotary table direct drive, current A, 1 kHz, M=0.6 A s2/rad B=0.3 Fc=0.5 A, 5 urad, cogging 0.15 A at 12 deg, current noise 20 mA",
 "fs=1000 T=16 M=0.6 B=0.3 Fc=0.5 rA=0.15 rP=0.20943951 c=1 amp=2.5 spd=3 acc=20 hold=0.2 cl=1 Kp=600 Kd=27 Mff=0.6 tf=0.002 yq=5e-6 un=0.02 yfac=1000","--time t --input u:A --position y:mrad")
ax("D6","injection plunger, force kN, 500 Hz, M=60 kg B=900 Fc=80 N, 1 um, force noise 4 N, multisine",
 "fs=500 T=20 M=60 B=900 Fc=80 c=2 amp=0.02 f0=0.2 f1=8 spd=0.9 ramp=0.5 cl=1 Kp=95000 Kd=3300 Mff=60 tf=0.003 yq=1e-6 un=4 dis=3 ufac=0.001 yfac=1000","--time t --input u:kN --position y:mm")
ax("D7","label printer, velocity setpoint in/s, 250 Hz, PI loop T=0.03 s rho=5, B=0.08 Fc=6 mm/s, 20 um",
 "fs=250 T=30 sub=30 mode=2 M=0.03 B=0.08 Fc=0.006 rho=5 c=4 amp=0.3 spd=0.8 hold=0.25 yq=2e-5 ufac=39.37007874 yfac=1000","--time t --input u:in/s --position y:mm")
ax("D8","ankle elastic actuator (load 40 %, 9 Hz), torque Nm, 1 kHz, J=0.08 B=0.3 Fc=0.3, 50 urad, torque noise 20 mNm, smooth start",
 "fs=1000 T=16 M=0.08 B=0.3 Fc=0.3 lf=0.4 cf=9 cz=0.08 c=2 amp=0.3 f0=0.3 f1=10 spd=0.9 ramp=1 cl=1 Kp=28 Kd=2.2 tf=0.003 yq=5e-5 un=0.02 yfac=57.29577951","--time t --input u:Nm --position y:deg")
ax("D9","centrifuge drive, torque mNm, 50 Hz, J=2e-3 B=1e-4 bq=1.5e-6 Fc=5 mNm, 1000/turn, rev, random speed",
 "fs=50 T=100 sub=40 M=0.002 B=1e-4 bq=1.5e-6 Fc=0.005 c=6 amp=80 hold=2.5 f0=0.25 cl=1 Kp=0.007 Kd=0.007 Mff=0.002 yq=0.00628 un=0.0006 ufac=1000 yfac=0.159154943","--time t --input u:mNm --position y:turns")
ax("D10","camera slider stepper, velocity mm/s, 200 Hz, P loop T=0.025 s, B=0.03 Fc=1 mm/s, 10 um, random walk",
 "fs=200 T=40 sub=20 mode=2 M=0.025 B=0.03 Fc=0.001 c=6 amp=0.12 hold=0.3 f0=1.8 cl=3 Kp=0.5 yq=1e-5 ufac=1000 yfac=1000","--time t --input u:mm/s --position y:mm")
cases.BASE.clear()
B={"D3":["drive.current_loop|drive.lag1|drive.delay"],"D4":["gantry.gravity"],"D5":["drive.ripple.motor"],"D8":["drive.compliance.belt"],"D9":["drive.friction.quadratic"]}
D=[k for k in AX if k[0]=="D"]
for a in D: c(a,"ref","reference","",B.get(a,[]))
NC={"D1":("amp=0.02 spd=0.1 acc=2","c=2 amp=0.005 f0=0.5 f1=12 spd=0.9 ramp=0.5"),"D2":("amp=14","c=4 amp=18 spd=0.8 hold=0.25"),"D3":("amp=0.18","c=2 amp=0.25 f0=0.05 f1=1.5 spd=0.5"),"D4":("amp=0.7","c=6 amp=1.1 hold=0.8 f0=0.5"),
"D5":("amp=1.5 spd=2","c=2 amp=1 f0=0.2 f1=4 spd=1 ramp=0.5"),"D6":("amp=0.014","c=1 amp=0.05 spd=0.2 acc=2 hold=0.2"),"D7":("amp=0.2","c=5 amp=0.3 hold=0.5"),"D8":("amp=0.2","c=1 amp=0.5 spd=2 acc=15 hold=0.2"),"D9":("amp=50","c=2 amp=60 f0=0.05 f1=0.5 spd=1 ramp=3"),"D10":("amp=0.08","c=4 amp=0.1 spd=0.8 hold=0.3")}
for a,(x,y) in NC.items(): S(a,"null1","",[],None,x,N); S(a,"null2","",[],None,y,N)
S("D8","nullcut","",[],None,"cut=3.05 T=19",N); S("B10","nullramp","",[],None,"c=2 amp=0.3 f0=0.3 f1=4 spd=1 ramp=1",N); S("B10","nullcut","",[],None,"c=2 amp=0.3 f0=0.3 f1=6.5 spd=1 ramp=1 cut=4.37 T=20",N)
S("D1","pre","pre=2e-5",["drive.friction.presliding"],{"force_n":1.5,"distance_m":2e-5}); S("D1","ripple","drA=1.5 drP=0.008",["drive.ripple.motor"],{"period_m":0.008}); S("D1","spring","dK=100",["gantry.stiffness"],{"stiffness_n_per_m":100})
S("D2","load","Kl=0.25",["drive.friction.load"],{"coefficient":0.25}); S("D2","quadratic","bq=0.05",["drive.friction.quadratic"],{"coefficient_n_s2_per_m2":0.05}); S("D2","ripple","drA=1.2 drP=0.8975979",["drive.ripple.motor"],{"period_m":0.8975979})
S("D3","asym","adv=0.4",["drive.friction.asymmetric"],{"viscous_difference_n_s_per_m":0.4}); S("D3","deadband","db=0.03",["drive.input_deadband"],{"threshold":0.03}); S("D3","endstop","es=4 eh=0.2 el=-0.2",["gantry.endstop"],{"stiffness_n_per_m":4})
S("D4","stribeck","Fs=2 vs=0.1",["drive.friction.stribeck"],{"force_n":2,"velocity_m_per_s":0.1}); S("D4","spring","dK=6",["gantry.stiffness"],{"stiffness_n_per_m":6}); S("D4","masspos","m1=0.5",["gantry.mass_position"],{"slope_kg_per_m":0.5})
S("D5","load","Kl=0.1",["drive.friction.load"],{"coefficient":0.1}); S("D5","gravity","dgA=0.6",["gantry.gravity"],{"sine_n":0.6}); S("D5","compliance","lf=0.5 cf=8 cz=0.04",["drive.compliance.belt"],{"load_fraction":0.5,"frequency_hz":8})
S("D6","stribeck","Fs=60 vs=0.01",["drive.friction.stribeck"],{"force_n":60,"velocity_m_per_s":0.01}); S("D6","endstop","es=60000 eh=0.012 el=-1",["gantry.endstop"],{"stiffness_n_per_m":60000}); S("D6","lag","lag=0.01",["drive.lag1"],{"time_constant_s":0.01})
S("D7","slew","slew=3",["drive.saturation.slew"],{"limit_m_per_s2":3}); S("D7","ripple","drA=0.03 drP=0.012",["drive.ripple.motor"],{"period_m":0.012}); S("D7","posfriction","dFc=0.015 pA=0.015 pL=0.3",["drive.friction.position"],{"length_m":0.3})
S("D8","delay","delay=0.004",["drive.delay"],{"delay_s":0.004}); S("D8","asym","adv=0.2",["drive.friction.asymmetric"],{"viscous_difference_n_s_per_m":0.2}); S("D8","quadratic","bq=0.08",["drive.friction.quadratic"],{"coefficient_n_s2_per_m2":0.08})
S("D9","thermal","dFc=0.015 th=-0.015 thT=30",["drive.friction.thermal_drift"],{"time_constant_s":30}); S("D9","delay","delay=0.06",["drive.delay"],{"delay_s":0.06}); S("D9","asym","adv=2e-4",["drive.friction.asymmetric"],{"viscous_difference_n_s_per_m":2e-4})
S("D10","lag","lag=0.03",["drive.lag1"],{"time_constant_s":0.03}); S("D10","stribeck","Fs=0.006 vs=0.01",["drive.friction.stribeck"],{"force_n":0.006,"velocity_m_per_s":0.01}); S("D10","spring","dK=0.15",["gantry.stiffness"],{"stiffness_n_per_m":0.15})
S("D1","ripple+spring","drA=1.5 drP=0.008 dK=100",["drive.ripple.motor","gantry.stiffness"],{"period_m":0.008,"stiffness_n_per_m":100},"",d); S("D2","load+lag","Kl=0.25 lag=0.02",["drive.friction.load",LAG],{"coefficient":0.25},"",d); S("D3","quadratic+asym","bq=1 adv=0.4",["drive.friction.quadratic","drive.friction.asymmetric"],{"coefficient_n_s2_per_m2":1,"viscous_difference_n_s_per_m":0.4},"",d)
S("D4","payload+load","dgA=6 dM=0.3 Kl=0.12",[R+"gravity+inertia","drive.friction.load"],{"coefficient":0.12},"",d); S("D5","stribeck+ripple","Fs=0.4 vs=0.15 drA=0.15 drP=0.0698",["drive.friction.stribeck","drive.ripple.motor"],{"force_n":0.4,"period_m":0.0698},"",d); S("D6","spring+stribeck","dK=6000 Fs=60 vs=0.01",["gantry.stiffness","drive.friction.stribeck"],{"stiffness_n_per_m":6000,"force_n":60},"",d)
S("D7","slew+delay","slew=3 delay=0.03",["drive.saturation.slew","drive.delay"],{"limit_m_per_s2":3,"delay_s":0.03},"",d); S("D8","load+delay","Kl=0.15 delay=0.004",["drive.friction.load","drive.delay"],{"coefficient":0.15,"delay_s":0.004},"",d); S("D9","thermal+delay","dFc=0.015 th=-0.015 thT=30 delay=0.06",["drive.friction.thermal_drift","drive.delay"],{"time_constant_s":30,"delay_s":0.06},"",d); S("D10","spring+stribeck","dK=0.15 Fs=0.006 vs=0.01",["gantry.stiffness","drive.friction.stribeck"],{"stiffness_n_per_m":0.15,"force_n":0.006},"",d)
# probes of found weaknesses
S("A8","endstopsoft","es=5 eh=0.05 el=-0.06",["gantry.endstop"],{"stiffness_n_per_m":5}); S("B7","endstop","es=8 eh=0.08 el=-0.08",["gantry.endstop"],{"stiffness_n_per_m":8}); S("B5","stribeck+spring2","Fs=1.5 vs=0.02 dK=2",["drive.friction.stribeck","gantry.stiffness"],{},"",d)
S("A3","spring+stribeck","dK=3 Fs=2.5 vs=0.12",["gantry.stiffness","drive.friction.stribeck"],{},"",d); S("A3","load+stribeck","Kl=0.15 Fs=2.5 vs=0.12",["drive.friction.load","drive.friction.stribeck"],{},"",d); S("A3","gravonly92","dgA=4",["gantry.gravity"],{},"amp=1.6"); S("A3","gravnew92","dgA=4",["gantry.gravity"],{},"amp=1.6","new"); S("A3","springnew","dK=3",["gantry.stiffness"],{},"","new")
