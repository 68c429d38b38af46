import numpy as np, ctypes, json, re, sys
lib=ctypes.CDLL('./sim.so')
names=re.search(r'enum \{(.*?)NPAR\}',open('./sim.c').read(),re.S).group(1).replace('\n','').replace(' ','').strip(',').split(',')
assert len(names)==lib.npar()
D=ctypes.POINTER(ctypes.c_double)
DEF=dict(M=1,VS=0.01,SD=1,RP=1,PFL=1,THT=30,GAIN=1,Z2=.05,EHI=1e9,ELO=-1e9,GN=1,KE=1,KP=1,BW=1,EDV=1,UMAX=1e9,VFIL=1)
def ptr(a): return a.ctypes.data_as(D)
def traj(rng,T,Tc,X,V,A,fhi,course):
    """random trapezoid moves + windowed multisine + chirp; 'steps' or 'sine' courses for the nulls"""
    n=int(T/Tc); t=np.arange(n)*Tc
    wt,ws={'mixed':(.6,.4),'sine':(.15,.85),'steps':(.95,.05),'slow':(.6,.2)}[course]
    q=np.zeros(n); pos=0.; v=0.; 
    # trapezoids through a velocity-limited profile
    vel=np.zeros(n); i=0
    while i<n:
        tgt=rng.uniform(-1,1)*X*wt; sp=V*rng.choice([.03,.1,.3,.6,.9] if course!='slow' else [.02,.05,.1,.2]); ac=A*rng.uniform(.4,.9)
        d=abs(tgt-pos); sgn=np.sign(tgt-pos); sp=min(sp,np.sqrt(d*ac)+1e-12)
        if d/sp>2.5: d=2.5*sp; tgt=pos+sgn*d
        ta=sp/ac; td=max(d/sp-ta,0); k=max(int((2*ta+td)/Tc),1)
        tt=np.arange(k)*Tc; prof=np.minimum.reduce([tt*ac,np.full(k,sp),np.maximum((2*ta+td-tt)*ac,0)])
        m=min(k,n-i); vel[i:i+m]=sgn*prof[:m]; i+=m; pos+=sgn*prof.sum()*Tc
        h=int(rng.uniform(0,.3)/Tc); i+=h
    q=np.cumsum(vel)*Tc
    def tukey(t,a,b,r): return np.clip((t-a)/r,0,1)*np.clip((b-t)/r,0,1)
    fl=fhi/25
    f=np.exp(rng.uniform(np.log(fl),np.log(fhi),7)); s=np.zeros(n)
    for x in f:
        w=2*np.pi*x; a=min(ws*X/2.2,.5*V/w,.6*A/w**2); s+=a*np.sin(w*t+rng.uniform(0,6.28))
    s*=tukey(t,(.1 if course=='sine' else .25)*T,(.95 if course=='sine' else .6)*T,.05*T)*.7
    a,b=(.7*T,.95*T); c=np.zeros(n); msk=(t>=a)&(t<=b); tc=t[msk]-a
    kk=np.log(fhi/fl)/(b-a); ph=2*np.pi*fl*(np.exp(kk*tc)-1)/kk; w=2*np.pi*fl*np.exp(kk*tc)
    c[msk]=np.minimum.reduce([np.full(len(w),ws*X/1.5),.6*V/w,.7*A/w**2])*np.sin(ph)*tukey(t[msk],a,b,.02*T)
    if course in('steps','slow'): c*=.1
    q=q+s+c
    m=max(int(.012*25/max(fhi,1)/Tc),3); ker=np.hanning(m+2)[1:-1]; ker/=ker.sum()
    q=np.convolve(np.r_[np.full(m,q[0]),q,np.full(m,q[-1])],ker,'same')[m:-m]
    vv=np.gradient(q,Tc); aa=np.gradient(vv,Tc); return q,vv,aa
def record(m,ov,seed,fn,course='mixed',T=None,off=0.,jit=0.,amp=1.,noise=1.,bw=None):
    p=dict(DEF); p.update(m['p']); nom=dict(p); p.update(ov)
    T=T or m['T']; fs=m['fs']; cr=m.get('ctrl',1); Tc=1/(fs*cr); ns=max(int(np.ceil(Tc/m.get('dt',4e-5))),2)
    rng=np.random.default_rng(seed); q,v,a=traj(rng,T,Tc,m['X']*amp,m['V'],m['A'],m['fhi'],course); q=q+off
    p['ENCN']=p.get('ENCN',0)*noise if p.get('ENCN',0)>0 else 0
    if noise!=1: p['ENCN']=max(p['ENCN'],p.get('ENCQ',0)*noise)
    if p.get('MODE',0)!=2:
        wn=2*np.pi*(bw or m['bw']); p.update(CKP=.95*nom['M']*wn**2,CKD=1.3*nom['M']*wn,FFA=.9*nom['M'],FFV=.9*nom.get('FV',0),FFC=.8*nom.get('FC',0))
        p['VFIL']=1-np.exp(-Tc*wn*6)
    else: p['CKP']=m.get('ckp',4.)
    P=np.array([p.get(k,0.) for k in names],float); n=len(q); u,qm,vm=np.zeros(n),np.zeros(n),np.zeros(n)
    q=np.ascontiguousarray(q); lib.sim(ptr(P),ctypes.c_int(seed),n,ns,ctypes.c_double(Tc),ptr(q),ptr(v),ptr(a),ptr(u),ptr(qm),ptr(vm))
    sl=slice(0,n,cr); t=np.arange(n)[sl]*Tc; u=u[sl]; qm=qm[sl]; vm=vm[sl]
    if jit: qm=qm+vm*rng.normal(0,jit,len(vm))
    assert np.isfinite(qm).all() and np.abs(qm).max()<50*m['X']+abs(off),(fn,np.abs(qm).max())
    iu,pu=m['iu'],m['pu']; fi={'mA':1e3,'A':1,'N':1,'Nm':1,'mNm':1e3,'V':1,'mm/s':1e3,'rpm':30/np.pi,'kNm':1e-3}
    U=u/m['supply0'] if iu=='duty' else u*fi[iu]
    fp={'um':1e6,'mm':1e3,'m':1,'rad':1,'deg':180/np.pi,'counts':m.get('cpt',1)/(2*np.pi)}[pu]
    cols=[t,U,qm*fp]; head='t_s,input,position'; fmt=['%.6f','%.7g','%.10g' if pu!='counts' else '%d']
    if m.get('velcol'): cols.append(vm+rng.normal(0,m['velcol'],len(vm))); head+=',velocity'; fmt.append('%.6g')
    np.savetxt(fn,np.column_stack(cols),delimiter=',',header=head,comments='',fmt=fmt)
    e=q[::cr]-qm
    return dict(urms=float(u.std()),qspan=float(np.ptp(qm)),vrms=float(vm.std()),vmax=float(np.abs(vm).max()),err=float(e.std()),still=float((vm==0).mean()))
pi=np.pi
MACH={
'VC':dict(desc='voice coil on a flexure, current mA',fs=1000,T=20,X=.004,V=.15,A=20,fhi=40,bw=15,iu='mA',pu='um',p=dict(M=.012,GN=8,K=30,FV=.35,FC=.008,LAG=.0003,ENCQ=.5e-6,UN=2e-4),base=['gantry.stiffness'],bp='stiffness 3.75 A/m, mass .0015, viscous .04375, coulomb .001'),
'SV':dict(desc='RC servo, duty, 4096 counts',fs=100,ctrl=5,T=30,X=1.0,V=4,A=50,fhi=6,bw=5,iu='duty',pu='deg',supply0=7.4,p=dict(MODE=1,M=.012,GN=.2027,KE=1.138,FC=.12,ENCQ=2*pi/4096,UMAX=7.4),base=[],bp='J/g .0592, Fc/g .592, ke 1.138'),
'GA':dict(desc='gantry linear motor, N',fs=250,ctrl=4,T=25,X=.4,V=1.2,A=6,fhi=10,bw=8,iu='N',pu='mm',p=dict(M=85,FC=45,FV=120,ENCQ=1e-6,UN=1.5),base=[],bp='M 85, Fc 45, Fv 120'),
'RJ':dict(desc='robot joint under gravity, Nm',fs=200,ctrl=5,T=40,X=1.2,V=1.5,A=6,fhi=6,bw=5,iu='Nm',pu='rad',p=dict(M=1.8,FC=9,FV=14,G=35,ENCQ=2*pi/409600,UN=.15),base=['drive.ripple.motor|gantry.stiffness (gravity)'],bp='gravity 35 Nm sin(q)'),
'PE':dict(desc='small pendulum direct drive, mNm',fs=500,T=20,X=2.4,V=8,A=60,fhi=8,bw=6,iu='mNm',pu='deg',p=dict(M=.004,FC=.006,FV=.004,G=.25,ENCQ=2*pi/32768,UN=4e-4),base=['drive.ripple.motor|gantry.stiffness (gravity)'],bp='gravity .25 Nm sin(q)'),
'BS':dict(desc='ball screw stage, current A, cogging',fs=1000,T=20,X=.06,V=.15,A=2,fhi=20,bw=15,iu='A',pu='um',p=dict(M=250,GN=628,FC=90,FV=900,RA=25,RP=.005/6,RPH=.7,LAG=.0003,ENCQ=.25e-6,UN=.004),base=['drive.ripple.motor'],bp='ripple 0.0398 A, period .8333 mm'),
'TT':dict(desc='direct drive turntable, Nm, counts',fs=400,T=20,X=15,V=12,A=40,fhi=10,bw=6,iu='Nm',pu='counts',cpt=262144,p=dict(M=.35,FC=.25,FV=.08,ENCQ=2*pi/262144,UN=.02),base=[],bp='J .35 Fc .25 Fv .08'),
'BV':dict(desc='belt axis, velocity setpoint mm/s, PI drive',fs=200,T=25,X=.3,V=.8,A=7,fhi=12,iu='mm/s',pu='mm',p=dict(MODE=2,M=6,KP=300,KI=4500,FC=8,FV=20,ENCQ=1e-5),base=[],bp='T .02 s, rho 15, Fc/Kp .02667, Fv/Kp .0667'),
'RV':dict(desc='rotary velocity setpoint rpm, P drive',fs=100,T=30,X=20,V=30,A=200,fhi=8,iu='rpm',pu='deg',ckp=3.,p=dict(MODE=2,M=.02,KP=.4,FC=.1,FV=.02,ENCQ=2*pi/10000),base=[],bp='T .05, Fc/Kp .25, Fv/Kp .05'),
'DC':dict(desc='24 V DC gear motor, voltage, velocity column',fs=500,T=20,X=20,V=25,A=120,fhi=10,bw=5,iu='V',pu='rad',velcol=.02,p=dict(MODE=1,M=.05,GN=.5,KE=.6,FC=.4,FV=.01,ENCQ=2*pi/20000,UMAX=23),base=[],bp='J/g .1, Fc/g .8, ke+Fv/g .62'),
'BE':dict(desc='belt axis, force N',fs=1000,T=20,X=.2,V=1.,A=12,fhi=45,bw=6,iu='N',pu='m',p=dict(M=8,FC=12,FV=15,ENCQ=2e-6,UN=.3),base=[],bp='M 8 Fc 12 Fv 15'),
'CR':dict(desc='crane slew drive, Nm, 50 Hz',fs=50,ctrl=10,dt=2e-4,T=60,X=.4,V=.2,A=.12,fhi=1.0,bw=.8,iu='Nm',pu='rad',p=dict(M=2.5e6,FC=9e3,FV=4e4,ENCQ=2*pi/2**20,UN=600),base=[],bp='J 2.5e6 Fc 9e3 Fv 4e4'),
}
# (name, machine, overrides, record-options, truth list, acceptable alternatives, true parameter, reason)
C=[]
def c(*a): C.append(a)
for k in MACH: c(k+'_base',k,None,{},MACH[k]['base'],[],MACH[k]['bp'],'single set; a plain axis is none/refit_only; sub-sample lag is documented as not named')
R='drive.'
c('VC_mass','VC',dict(M=.014),{},['gantry.inertia'],[],'mass .0015 -> .00175','')
c('VC_kt','VC',dict(GN=7.3),{},['drive.gain'],['all parameters of inertia/stiffness/viscous/coulomb +9.6 %'],'gain .9125','gain equals a common scale of all parameters')
c('VC_null_course','VC',{},dict(course='sine'),[],[],'-','only the course')
c('SV_loadfric','SV',dict(KL=.15),{},[R+'friction.load'],[],'coefficient .15','')
c('SV_deadband','SV',dict(DB=.37),{},[R+'input_deadband'],[R+'friction.coulomb (partly)'],'threshold .37 V lost 1','slid motion alone equals Coulomb')
c('SV_supply','SV',dict(GAIN=6.7/7.4),{},['drive.gain'],['all parameters scaled 1.104'],'gain .905','')
c('SV_null_noise','SV',{},dict(noise=2),[],[],'-','encoder noise 2 counts rms')
c('GA_payload','GA',dict(M=97),{},['gantry.inertia'],[],'85->97 kg','')
c('GA_asym','GA',dict(DC=24),{},[R+'friction.asymmetric'],[R+'offset','gantry.tilt'],'d_c 24 N','constant force 12 N in the sign of.. level differs by 24: +12 in plus, -12 in minus = offset of 12 N exactly while sliding')
c('GA_tilt','GA',dict(F0=15),{},['gantry.tilt'],[R+'offset',R+'friction.asymmetric'],'15 N','identical while sliding')
c('GA_posfric','GA',dict(PFA=14,PFL=.35),{},[R+'friction.position'],[],'sine 14 N, L .35 m','')
c('GA_out_detent','GA',dict(BF=45,BQ=.05,BW=.012),{},['unexplained'],[],'local detent 45 N, 12 mm wide','outside catalogue')
c('GA_null_start','GA',{},dict(course='steps',off=.15,amp=.7),[],[],'-','other start position and course')
c('RJ_stribeck','RJ',dict(FS=5,VS=.06),{},[R+'friction.stribeck'],[],'5 Nm, .06 rad/s, exp 1','')
c('RJ_viscous','RJ',dict(FV=20),{},[R+'friction.viscous'],[],'14->20','')
c('RJ_thermal','RJ',dict(THC=-3.5,THT=12),{},[R+'friction.thermal_drift'],[],'-3.5 Nm, 12 s','')
c('RJ_null_range','RJ',{},dict(off=.5,amp=.5,course='sine'),[],[],'-','other range and course')
c('PE_tip','PE',dict(M=.0052,G=.3089),{},['gantry.inertia','gravity parameter (ripple/stiffness)'],[],'J .004->.0052, G .25->.3089','')
c('PE_spring','PE',dict(K=.08),{},['gantry.stiffness'],[],'.08 Nm/rad','')
c('BS_presliding','BS',dict(PD=15e-6),{},[R+'friction.presliding'],[],'.1433 A, 15 um','')
c('BS_preload','BS',dict(FC=140),{},[R+'friction.coulomb'],[],'.1433 -> .2229 A','')
c('BS_null_noise','BS',{},dict(noise=2),[],[],'-','encoder noise 0.5 um rms added')
c('TT_drag','TT',dict(FQ=.012),{},[R+'friction.quadratic'],[],'.012','')
c('TT_delay','TT',dict(DELAY=.003),{},[R+'delay'],[R+'lag1',R+'current_loop'],'3 ms','')
c('TT_cog','TT',dict(RA=.3,RP=2*pi/24,RPH=.4),{},[R+'ripple.motor'],[],'.3 Nm, period .2618 rad','')
c('TT_null_jitter','TT',{},dict(jit=5e-5),[],[],'-','50 us time jitter')
c('BV_slew','BV',dict(SLEW=4.),{},[R+'saturation.slew'],[],'4 m/s2','')
c('BV_delay','BV',dict(DELAY=.008),{},[R+'delay'],[R+'lag1'],'8 ms','')
c('BV_coulomb','BV',dict(FC=16),{},[R+'friction.coulomb'],[],'.0267->.0533 m/s','')
c('BV_null_course','BV',{},dict(course='steps'),[],[],'-','course')
c('BV_out_vib','BV',dict(XA=10,XF=2.7),{},['unexplained'],[],'10 N at 2.7 Hz from outside','time-periodic force')
c('RV_lag','RV',dict(LAG=.025),{},[R+'lag1'],[R+'delay'],'25 ms','')
c('RV_gain','RV',dict(GAIN=.94),{},[R+'gain'],[R+'friction.viscous (and T, Coulomb 1.064: same)'],'gain .94','P drive: gain = scale of all parameters, viscous (1+Fv/Kp)/.94')
c('RV_sat','RV',dict(USAT=16.),{},[R+'saturation.speed'],[],'16 rad/s','')
c('DC_hot','DC',dict(GN=.5/1.18),{},['refit: inertia, coulomb'],[R+'gain + viscous'],'J .1->.118, Fc .8->.944, Fv .62->.6236','winding +18 %')
c('DC_sat','DC',dict(USAT=12.),{},[R+'saturation.speed'],[],'12 V','')
c('DC_sag','DC',dict(SAG=.5/24**2),{},[R+'supply_sag'],[R+'saturation.torque_speed'],'0.5 ohm of 24 V','')
c('DC_out_eddy','DC',dict(EDF=1.2,EDV=6.),{},['unexplained'],[],'eddy brake 1.2 Nm at 6 rad/s','outside catalogue')
c('DC_null_course','DC',{},dict(course='sine'),[],[],'-','course')
c('BE_compliance','BE',dict(ML=5,F2=25,Z2=.04),{},[R+'compliance.belt'],[],'load fraction .625, f 25 Hz','')
c('BE_endstop','BE',dict(EK=8000,EHI=.07),{},['gantry.endstop'],[],'8000 N/m from .07 m','')
c('BE_out_backlash','BE',dict(ML=5,F2=60,Z2=.1,GAP=.0012),{},['unexplained'],[R+'compliance.belt (partly)'],'1.2 mm play','documented as not tested on an axis')
c('CR_load','CR',dict(M=3.0e6),{},['gantry.inertia'],[],'2.5e6 -> 3.0e6','')
if __name__=='__main__':
    cases=[]; seed=2700
    for nm,mk,ov,opt,truth,alt,tp,why in C:
        m=MACH[mk]; files=[]; st=[]
        for i in (1,2):
            seed+=1; fn=f'./csv/{nm}-{i}.csv'; st.append(record(m,ov or {},seed,fn,**opt)); files.append(fn)
        s=st[0]; print(f"{nm:16s} u {s['urms']:.3g} span {s['qspan']:.3g} v {s['vrms']:.3g} max {s['vmax']:.3g} err {s['err']:.2g} still {s['still']:.2f}")
        cases.append(dict(name=nm,machine=mk,description=m['desc'],kind={'V':'voltage','duty':'voltage (duty)','A':'current','mA':'current','mm/s':'velocity setpoint','rpm':'velocity setpoint'}.get(m['iu'],'force/torque'),input_unit=m['iu'],position_unit=m['pu'],rate_hz=m['fs'],seconds=m['T'],single=ov is None,changed={k:v for k,v in (ov or {}).items()},course=opt,truth=truth,acceptable=alt,true_parameter=tp,reason=why,files=files,machine_parameters=m['p'],stats=st))
    json.dump(cases,open('./cases.json','w'),indent=1); print(len(cases))
