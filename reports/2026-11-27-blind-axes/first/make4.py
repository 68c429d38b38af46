from machines2 import *
R='drive.'
M1=MACH
def run(nm,mk,mm,ov,opt,truth,tp):
    C2.append((nm,mk,mm,ov,opt,truth,tp))
run('GA_stribeck4','GA',M2,dict(FS=30,VS=.02),dict(course='slow'),[R+'friction.stribeck'],'30 N .02 m/s, slow motion with many reversals')
run('GA_stribeck5','GA',M2,dict(FS=30,VS=.08),{},[R+'friction.stribeck'],'30 N .08 m/s')
run('DC_worm4','DC',M2,dict(KL=.1),{},[R+'friction.load'],'.1 of motor torque')
run('GA_load4','GA',M2,dict(KL=.1),{},[R+'friction.load'],'.1')
run('TT_load4','TT',M2,dict(KL=.1),{},[R+'friction.load'],'.1')
run('BE_comp12','BE',M2,dict(ML=3,F2=12,Z2=.05),{},[R+'compliance.belt'],'.6, 12 Hz (500 Hz)')
run('BE_comp16','BE',M2,dict(ML=3,F2=16,Z2=.05),{},[R+'compliance.belt'],'.6, 16 Hz (500 Hz)')
run('BE_comp_load4','BE',M2,dict(ML=1.5,F2=18,Z2=.08,ENCLOAD=1),dict(bw=1.2),[R+'compliance.belt'],'load encoder, 18*sqrt(5/3.5)=21.5 Hz')
run('RV_lag4','RV',M2,dict(LAG=.03),{},[R+'lag1'],'30 ms')
run('BV_lag4','BV',M2,dict(LAG=.06),{},[R+'lag1'],'60 ms')
run('TT_jit4','TT',M2,{},dict(jit=1e-5),[],'10 us jitter')
run('BE_coul_visc4','BE',M2,dict(FC=12,FV=16),{},[R+'friction.coulomb',R+'friction.viscous'],'8->12, 10->16')
run('BS_presl4','BS',M2,dict(PD=5e-6),{},[R+'friction.presliding'],'.125 A 5 um')
run('DC_stribeck4','DC',M2,dict(FS=.3,VS=.8),{},[R+'friction.stribeck'],'.75 V, .8 rad/s')
run('DC_asym4','DC',M2,dict(DC=.16),{},[R+'offset'],'+-.2 V -> offset .2 V')
run('DC_spring4','DC',M2,dict(K=.15),{},['gantry.stiffness'],'.375 V/rad')
run('DC_cog4','DC',M2,dict(RA=.2,RP=2*pi/7,RPH=.3),{},[R+'ripple.motor'],'.5 V, period .8976')
run('CR_thermal4','CR',M2,dict(THC=-2.5e3,THT=20),{},[R+'friction.thermal_drift'],'-2500, 20 s')
run('VC_gravity4','VC',M2,dict(F0=.1962),{},['gantry.tilt'],'.01784 A')
run('VC_endstop4','VC',M2,dict(EK=4000,EHI=.0015),{},['gantry.endstop'],'363.6 A/m from 1.5 mm')
run('GA_slew_current','GA',M2,dict(USAT=260),{},[R+'saturation.speed'],'260 N amplifier limit')
run('RV_cog4','RV',M2,dict(RA=.25,RP=2*pi/6,RPH=.3),{},[R+'ripple.motor'],'.1667 rad/s, period 1.047')
run('RV_tilt4','RV',M2,dict(F0=.3),{},['gantry.tilt'],'.2 rad/s')
cases=[];seed=330000
for nm,mk,mm,ov,opt,truth,tp in C2:
    m=mm[mk];files=[];st=[]
    for i in (1,2):
        seed+=1; fn=f'./csv/{nm}-{i}.csv'; st.append(record(m,ov,seed,fn,**opt)); files.append(fn)
    x=st[0]; print(nm,x)
    cases.append(dict(name=nm,machine=mk,set=4,description=m['desc'],kind={'V':'voltage','duty':'voltage (duty)','A':'current','mA':'current','mm/s':'velocity setpoint','rpm':'velocity setpoint'}.get(m['iu'],'force/torque'),input_unit=m['iu'],position_unit=m['pu'],rate_hz=m['fs'],seconds=m['T'],single=False,changed=ov,course=opt,truth=truth,acceptable=[],true_parameter=tp,reason='',files=files,machine_parameters=m['p'],stats=st))
json.dump(cases,open('./cases4.json','w'),indent=1)
