import numpy as np, math, sys
import cases as C
from cases import out, CASES, R, sg, slewpre, delaypre, mkload, D, RPM
from sim import *
CASES.clear()
def rm(name,s,r,fs,span,vmax,amax,T=13.,jerk=.06,dwell=.3,micro=0.):
    """random point-to-point moves inside +-span/2 with speeds from 0.1 to 1 vmax, log-uniform, for about T seconds"""
    g=np.random.default_rng(sum(map(ord,name))*37+10*s+r); x=0.;mv=[];tt=0.
    while tt<T:
        y=g.uniform(-span/2,span/2)
        if abs(y-x)<.15*span: continue
        v=vmax*10**g.uniform(-1,0) if len(mv)%2 else vmax*g.uniform(.6,1); a=amax*10**g.uniform(-.6,0)
        tt+=abs(y-x)/v+v/a+dwell
        if abs(y-x)/v>5: tt-=abs(y-x)/v+v/a+dwell; continue
        mv.append((y-x,v,a,dwell)); x=y
        if micro and g.random()<.5:
            for k in range(3): mv+= [(micro,vmax*.05,amax*.3,.1),(-micro,vmax*.05,amax*.3,.1)]
    return ptp(fs,mv,jerk)
def rs(name,s,r,fs,a,T=11.,ramp=.1,chT=4.,f1=2.5,ca=.4):
    g=np.random.default_rng(sum(map(ord,name))*41+10*s+r); seq=[(0,.4)];t=0
    while t<T:
        l=g.choice([-1,1])*a*10**g.uniform(-1,0); d=g.uniform(.8,2.2); seq.append((l,d)); t+=d
    return np.concatenate([steps(fs,seq,ramp),chirp(fs,chT,.2,f1,a*ca),np.zeros(int(.4*fs))])
# ------ singles
def b_throttle(s,r):
    fs=500; ref=rm('b_throttle',s,r,fs,1.2,6.,60.,9.,.03)
    K=.35 # Nm/A at the plate; J 2e-3
    return force_axis(fs,10,ref,2e-3/K,.06/K,.02/K,-.15/K,kp=6.,kd=.25,extra=lambda q,v,t:-.11/K*q)
out('b_throttle','single','i_A','A',1,.01,'plate','deg',1/D,.01,.02,['gantry.stiffness'],['gantry.gravity (range 69 deg: sine close to a line)'],b_throttle,params=dict(k=.11/.35,mass=2e-3/.35,coulomb=.06/.35))
def b_rope(s,r):
    fs=100; ref=rm('b_rope',s,r,fs,30,2.5,1.2,26.,.4,1.)
    # mine hoist, rope without tail rope: 6.5 kg/m*9.81*2 = 128 N/m imbalance
    return force_axis(fs,20,ref,5200,900,200,-3000,kp=120e3,kd=40e3,extra=lambda q,v,t:128*q)
out('b_rope','single','force','kN',1e-3,.05,'cage','m',1,.0005,.001,['gantry.stiffness'],[],b_rope,params=dict(k=-128,mass=5200))
def b_drum(s,r):
    fs=200
    V=rs('b_drum',s,r,fs,24,16.,.3,.01,1,0)
    k=.2
    return force_axis(fs,10,None,.03/k,.06/k,.05/k,0,openloop=V,extra=lambda q,v,t:-.35/k*math.sin(q+.5))
out('b_drum','single','u','V',1,.02,'angle','deg',1/D,.02,.05,['gantry.gravity'],['drive.ripple.motor with period 2 pi'],b_drum,params=dict(amp=1.75,mass=.15,viscous=.25))
def b_fan(s,r):
    fs=100; ref=cat(*[multisine(fs,.1,[(0,1,0)])]+[ptp(fs,[(d,v,a,.5) for d,v,a in [[(300,60,30),(-200,40,20),(150,25,30),(-250,60,25)],[(-260,50,30),(300,60,20),(-80,15,10),(120,35,25)],[(200,30,30),(-350,60,30),(150,45,15),(-60,12,10)],[(-300,60,22),(180,30,18),(120,50,30),(-90,20,20)]][2*s+r]],.3)])
    return force_axis(fs,20,ref,.4,.3,.02,0,kp=20,kd=4,extra=lambda q,v,t:-2.5e-3*v*abs(v))
out('b_fan','single','torque','Nm',1,.06,'phi','turns',1/(2*math.pi),.00005,1/8192,['drive.friction.quadratic'],[],b_fan,params=dict(cq=2.5e-3,mass=.4,coulomb=.3,viscous=.02))
def b_cart(s,r):
    fs=200; V=rs('b_cart',s,r,fs,11,12.,.08,5,2.5,.5); u0=.9
    def dr(u,v,t,z,dt): return 0. if abs(u)<u0 else u
    return force_axis(fs,20,None,1.4,.35,6.,0,openloop=V,drive=dr)
out('b_cart','single','u','V',1,0.,'x','mm',1e3,.05,.1,['drive.input_deadband'],[],b_cart,params=dict(threshold=.9,lost=0),note='lost_fraction 0: the drive ignores commands below .9 V and passes larger ones whole')
def b_curlimit(s,r):
    fs=250; ref=rm('b_curlimit',s,r,fs,1.2,1.0,6.,11.,.05)
    return force_axis(fs,20,ref,6.,1.2,1.5,0,kp=600,kd=110,drive=lambda u,v,t,z,dt:max(-14.,min(14.,u)))
out('b_curlimit','single','i_set','A',1,0.05,'trolley','mm',1e3,.01,.02,['drive.saturation.speed'],['drive.saturation.torque_speed'],b_curlimit,params=dict(limit=14))
def b_presl(s,r):
    fs=1000; ref=rm('b_presl',s,r,fs,.02,.03,.6,10.,.03,.15,micro=4e-4)
    st=[0.]; d=40e-6; Fb=35.; h=1/(fs*20.)
    def ex(q,v,t):
        st[0]=max(-1.,min(1.,st[0]+(v-abs(v)*st[0])/d*h)); return -Fb*st[0]
    return force_axis(fs,20,ref,60.,4.,250,0,kp=3e5,kd=8e3,extra=ex)
out('b_presl','single','force','N',1,.4,'x','um',1e6,.05,.1,['drive.friction.presliding'],[],b_presl,params=dict(force=35,distance=40e-6,mass=60,coulomb=4))
def b_loadside(s,r):
    # encoder on the load, motor collocated control; motor torque is the input
    fs=1000; g=R(s,r+50); dt=1/(fs*20); Jm,Jl=.004,.006; w=2*math.pi*14; kk=w*w/(1/Jm+1/Jl); c=2*.06*kk/w
    ref=cat(rm('b_loadside',s,r,fs,12,14,180,6.,.03,.15),multisine(fs,5,[(a,f,g.uniform(0,6)) for a,f in ((.5,1.3),(.12,3.7),(.04,7.9),(.02,11.7),(.012,16.3),(.008,21.))]))
    n=len(ref[0]); qm=vm=ql=vl=0.; T=[];U=[];Q=[]
    for k in range(n):
        u=1.2*(ref[0][k]-qm)+.12*(ref[1][k]-vm)+(Jm+Jl)*ref[2][k]
        T.append(k/fs);U.append(u);Q.append(ql)
        for j in range(20):
            tq=kk*(qm-ql)+c*(vm-vl); vm+=dt*(u-tq)/Jm; qm+=dt*vm
            vf=vl+dt*(tq-.004*vl)/Jl; fr=.03*dt/Jl; vl=vf-fr if vf>fr else vf+fr if vf<-fr else 0.; ql+=dt*vl
    return np.array(T),np.array(U),np.array(Q)
out('b_loadside','single','mNm','mNm',1e3,4.,'load','rad',1,.0001,.0002,['drive.compliance.belt'],[],b_loadside,params=dict(note='f of motor against load: T = 2 pi sqrt(Jm/k)',T=2*math.pi*math.sqrt(.004/((2*math.pi*14)**2/(1/.004+1/.006)))))
def b_thermal(s,r):
    fs=100; ref=rm('b_thermal',s,r,fs,2.,.8,2.,28.,.1)
    return force_axis(fs,20,ref,90.,70.,30.,0,kp=15e3,kd=2.5e3,fric=lambda q,v,t,F:-30*(1-math.exp(-t/22)),t0=r*31.)
out('b_thermal','single','F','N',1,3.,'belt','m',1,.0001,.0002,['drive.friction.thermal_drift'],[],b_thermal,params=dict(coulomb_change=-30,T=22,coulomb=70,note='session 2 also starts cold'))
def b_asym(s,r):
    fs=200; ref=rm('b_asym',s,r,fs,.6,.5,2.,12.,.08)
    return force_axis(fs,20,ref,350.,150.,900.,0,kp=50e3,kd=9e3,extra=lambda q,v,t:-450.*abs(v))
out('b_asym','single','F_lbf','lbf',1/4.4482216,1.5,'rod','in',1/.0254,.0005,.001,['drive.friction.asymmetric'],[],b_asym,params=dict(viscous_difference=900,mass=350))
def lagpre(tau):
    def f(s,t,z,dt):
        w=z.get('l',0.); w+=dt*(s-w)/tau; z['l']=w; return w
    return f
def b_vlag(s,r):
    fs=125; S=rs('b_vlag',s,r,fs,1.2,11.,0.,5,3,.4)
    return velocity_axis(fs,20,S,.03,1,8,.02,.1,0,pre=lagpre(.09))
out('b_vlag','single','w','rad/s',1,0,'q','rad',1,.0002,.0005,['drive.lag1'],[],b_vlag,params=dict(tau=.09,T=.03,rho=8))
def b_vcog(s,r):
    fs=250; S=rs('b_vcog',s,r,fs,90*D,12.,.1,3,2,.3)
    dt=1/(fs*20); q=v=0.; T=[];U=[];Q=[]; I=0.
    for k in range(len(S)):
        w=float(S[k]); T.append(k/fs);U.append(w);Q.append(q)
        for j in range(20):
            e=w-v; vf=v+dt*(e-.05*v+.12*math.sin(18*q+1.))/.06; fr=.03*dt/.06
            v=vf-fr if vf>fr else vf+fr if vf<-fr else 0.; q+=v*dt
    return np.array(T),np.array(U),np.array(Q)
out('b_vcog','single','rate','deg/s',1/D,0,'deg','deg',1/D,.002,.005,['drive.ripple.motor'],[],b_vcog,params=dict(amp=.12,period=2*math.pi/18,T=.06))
def b_softstop(s,r):
    fs=250; ref=rm('b_softstop',s,r,fs,.5,.5,3.,12.,.05)
    return force_axis(fs,20,ref,12.,4.,10.,0,kp=6e3,kd=400,extra=lambda q,v,t:-2500*(q-.17) if q>.17 else 0.)
out('b_softstop','single','F','N',1,.5,'x','mm',1e3,.01,.02,['gantry.endstop'],[],b_softstop,params=dict(k=2500,high=.17,note='only the upper end'))
def b_stops2(s,r):
    fs=250; ref=rm('b_stops2',s,r,fs,3.0,3.,25.,12.,.05)
    def ex(q,v,t): return -90.*(q-1.1) if q>1.1 else -90.*(q+1.2) if q<-1.2 else 0.
    return force_axis(fs,20,ref,.25,.5,.2,0,kp=150,kd=10,extra=ex)
out('b_stops2','single','tau','Nm',1,.04,'joint','rad',1,.0002,.0005,['gantry.endstop'],[],b_stops2,params=dict(k=90,low=-1.2,high=1.1))
# ------ doubles
def b_cogdelay(s,r):
    fs=1000; ref=rm('b_cogdelay',s,r,fs,.3,.4,8.,10.,.03); 
    def dr(u,v,t,z,dt):
        b=z[3] or [0.]*round(.006/dt); b.append(u); z[3]=b; return b.pop(0)
    return force_axis(fs,10,ref,8.,3.,10.,0,kp=9e3,kd=350,drive=dr,extra=lambda q,v,t:5.*math.sin(2*math.pi*q/.032))
out('b_cogdelay','double','F','N',1,.3,'x','mm',1e3,.002,.005,['drive.ripple.motor','drive.delay'],['drive.lag1/current_loop for delay'],b_cogdelay,params=dict(ripple=5,period=.032,delay=.006))
def b_quadspring(s,r):
    fs=100; ref=rm('b_quadspring',s,r,fs,1.6,1.5,4.,18.,.1)
    return force_axis(fs,20,ref,25.,8.,5.,0,kp=4e3,kd=600,extra=lambda q,v,t:-40.*v*abs(v)-60.*q)
out('b_quadspring','double','F','N',1,1.,'x','m',1,.0002,.0005,['drive.friction.quadratic','gantry.stiffness'],[],b_quadspring,params=dict(cq=40,k=60))
def b_posstrib(s,r):
    fs=500; ref=rm('b_posstrib',s,r,fs,.4,.15,1.,14.,.05)
    return force_axis(fs,20,ref,40.,20.,60.,0,kp=4e4,kd=6e3,fric=lambda q,v,t,F:30*q+18*math.exp(-abs(v/.012)))
out('b_posstrib','double','F','N',1,.5,'x','mm',1e3,.002,.005,['drive.friction.position','drive.friction.stribeck'],[],b_posstrib,params=dict(slope=30,stribeck=18,vs=.012))
def b_vdeaddelay(s,r):
    fs=100; S=rs('b_vdeaddelay',s,r,fs,.5,14.,.2,8,.8,.25); de=delaypre(.08); u0=.04
    return velocity_axis(fs,20,S,.1,1,0,.002,.05,0,pre=lambda w,t,z,dt:(lambda x:0. if abs(x)<u0 else x-u0*sg(x))(de(w,t,z,dt)))
out('b_vdeaddelay','double','v','m/s',1,0,'x','m',1,.0001,.0002,['drive.input_deadband','drive.delay'],['drive.lag1 for delay'],b_vdeaddelay,params=dict(threshold=.04,lost=1,delay=.08))
def b_gravload(s,r):
    fs=250; ref=rm('b_gravload',s,r,fs,2.4,2.,12.,11.,.06)
    return force_axis(fs,10,ref,.8,.5,.4,0,kp=500,kd=40,extra=lambda q,v,t:-9.*math.cos(q),fric=lambda q,v,t,F:.12*abs(F))
out('b_gravload','double','tq','Nm',1,.05,'elbow','deg',1/D,.005,.01,['gantry.gravity','drive.friction.load'],[],b_gravload,params=dict(amp=9,K=.12))
# ------ nulls
def b_nneg(s,r):
    fs=200; ref=rm('b_nneg',s,r,fs,.8,.7,3.,11.,.05)
    return force_axis(fs,20,ref,18.,9.,14.,3.,kp=6e3,kd=700)
out('b_nneg','null','i_raw','A',-1,.05,'x','cm',1e2,.001,.002,[],[],b_nneg,args=['--input-scale','-1'],params=dict(mass=18,coulomb=9,viscous=14,offset=-3))
def b_nvelo(s,r):
    fs=400; ref=rm('b_nvelo',s,r,fs,60,40,300,11.,.05)
    return force_axis(fs,10,ref,3e-4,.012,2e-4,0,kp=.08,kd=.012)
out('b_nvelo','null','tq','mNm',1e3,.5,'q','turns',1/(2*math.pi),.0002,1/2000,[],[],b_nvelo,params=dict(mass=3e-4,coulomb=.012,viscous=2e-4))
def b_nloud(s,r):
    fs=100; ref=rm('b_nloud',s,r,fs,3.,1.,2.,22.,.1)
    return force_axis(fs,20,ref,40.,25.,10.,0,kp=5e3,kd=900)
out('b_nloud','null','F','N',1,12.,'x','m',1,.0005,.001,[],[],b_nloud,params=dict(mass=40,coulomb=25,viscous=10),note='loud force sensor: 12 N RMS')
def b_nvel2(s,r):
    fs=50; S=rs('b_nvel2',s,r,fs,.8,22.,.2,6,1.2,.4)
    return velocity_axis(fs,40,S,.2,1,1.2,.06,.05,.02)
out('b_nvel2','null','v','m/s',1,0,'x','m',1,.0005,.001,[],[],b_nvel2,params=dict(T=.2,rho=1.2,coulomb=.06))
def b_nvolt(s,r):
    fs=1000; V=rs('b_nvolt',s,r,fs,6,9.,.01,4,5,.4)
    return force_axis(fs,10,None,.02,.4,.05,0,openloop=V)
out('b_nvolt','null','mv','mV',1e3,5.,'enc','counts',4096/(2*math.pi),.2,1,[],[],b_nvolt,args=['--counts-per-turn','4096'],params=dict(mass=.02,coulomb=.4,viscous=.05))
# ------ physics outside the catalogue: any name is wrong; the right verdict is unexplained (or none where it is below the floor)
def o_cubic(s,r):
    fs=200; ref=rm('o_cubic',s,r,fs,3.,2.5,8.,12.,.06)
    return force_axis(fs,20,ref,15.,5.,4.,0,kp=3e3,kd=350,extra=lambda q,v,t:-2.5*v**3)
out('o_cubic','outside','F','N',1,.5,'x','m',1,.0001,.0002,[],['drive.friction.quadratic (nearest)'],o_cubic,params=dict(c3=2.5))
def o_hard(s,r):
    fs=200; ref=rm('o_hard',s,r,fs,.4,.6,5.,12.,.05)
    return force_axis(fs,20,ref,5.,2.,6.,0,kp=3e3,kd=200,extra=lambda q,v,t:-4000.*q**3)
out('o_hard','outside','F','N',1,.4,'x','mm',1e3,.01,.02,[],['gantry.endstop, gantry.stiffness (nearest)'],o_hard,params=dict(k3=4000))
def o_magsat(s,r):
    fs=250; ref=rm('o_magsat',s,r,fs,1.2,1.2,8.,11.,.05)
    # force falls behind current: F = 20 tanh(i/20)*... soft saturation of the torque constant
    return force_axis(fs,20,ref,4.,1.5,2.,0,kp=700,kd=80,drive=lambda u,v,t,z,dt:30*math.tanh(u/30))
out('o_magsat','outside','i','A',1,.08,'x','mm',1e3,.01,.02,[],['drive.saturation.speed, torque_speed (nearest)'],o_magsat,params=dict(knee=30))
def o_ecc(s,r):
    fs=250; ref=rm('o_ecc',s,r,fs,40.,18.,90.,12.,.06)
    t,u,q=force_axis(fs,20,ref,.02,.1,.01,0,kp=2.,kd=.5)
    return t,u,q+.012*np.sin(q+.4)
out('o_ecc','outside','tau','Nm',1,.01,'motor','deg',1/D,.005,.01,[],['drive.ripple.motor with the period of a turn (nearest)'],o_ecc,params=dict(ecc=.012),note='encoder eccentricity: catalogue says only for tables')
def o_wind(s,r):
    fs=100; ref=rm('o_wind',s,r,fs,1.5,.8,1.5,20.,.1); g=np.random.default_rng(77+10*s+r); st=[0.,-1]
    def ex(q,v,t):
        k=int(t*20*fs)
        st[0]+= (1/(20*fs))*(-st[0]/.8)+ g.normal()*math.sqrt(2/.8/(20*fs))*25.
        return st[0]
    return force_axis(fs,20,ref,120.,40.,60.,0,kp=15e3,kd=3e3,extra=ex)
out('o_wind','outside','F','N',1,2.,'az','m',1,.0001,.0002,[],['unexplained or none'],o_wind,params=dict(sd=25,tau=.8))
def o_maxwell(s,r):
    fs=250; ref=rm('o_maxwell',s,r,fs,.02,.02,.3,12.,.05,.2); st=[0.,0.,0.,0.]; lim=(8.,6.,4.,3.); ks=(4e4,1e4,3e3,8e2)
    h=1/(fs*20.)
    def ex(q,v,t):
        f=0.
        for i in range(4):
            st[i]=max(-lim[i],min(lim[i],st[i]+ks[i]*v*h)); f-=st[i]
        return f
    return force_axis(fs,20,ref,10.,2.,50.,0,kp=8e4,kd=2e3,extra=ex)
out('o_maxwell','outside','F','N',1,.2,'x','um',1e6,.1,.2,[],['drive.friction.presliding (nearest: also hysteresis)'],o_maxwell,params=dict(),note='piezo/rubber hysteresis by four Maxwell slips, up to 3.7 mm')
if __name__=='__main__':
    import time
    for n in (sys.argv[1:] or CASES):
        a=time.time(); C.build(n); print(n,CASES[n]['kind'],round(time.time()-a,1),flush=True)

