import numpy as np, math, sys, json
import cases as C
from cases import out, CASES, sg, slewpre, delaypre, mkload
from sim import steps, chirp, ptp, velocity_axis
CASES.clear()
def lagpre3(tau):
    def f(s,t,z,dt):
        w=z.get('l',0.); w+=dt*(s-w)/tau; z['l']=w; return w
    return f
def faxis(fs,sub,ref,M,Fc,Fv,F0,kp,kd,extra=None,fric=None,drive=None,load=None,dmdq=0.,t0=0.,dahl=None):
    dt=1/(fs*sub); n=len(ref[0]); T=[];U=[];Q=[]; q=0.;v=0.;u=0.;z=[0.]*4; zd=0.
    for k in range(n):
        r,rd,rdd=ref[0][k],ref[1][k],ref[2][k]; kk=min(k+1,n-1); dr=(ref[0][kk]-r)/sub; dv=(ref[1][kk]-rd)/sub; da=(ref[2][kk]-rdd)/sub
        for j in range(sub):
            t=t0+k/fs+j*dt
            u=kp*(r-q)+kd*(rd-v)+M*rdd+Fv*rd-F0
            F=u if drive is None else drive(u,v,t,z,dt)
            if j==0: T.append(t);U.append(u);Q.append(q)
            f=F+F0
            if extra is not None: f+=extra(q,v,t)
            if load is not None: f+=load(q,v,z,dt)
            if dahl: zd=max(-1.,min(1.,zd+(v-abs(v)*zd)/dahl[1]*dt)); f-=dahl[0]*zd
            Mq=M+dmdq*q; f-=.5*dmdq*v*v
            lev=Fc if fric is None else max(0.,Fc+fric(q,v,t,F))
            vf=v+dt*(f-Fv*v)/Mq; fr=lev*dt/Mq
            v=vf-fr if vf>fr else vf+fr if vf<-fr else 0.
            q+=v*dt; r+=dr; rd+=dv; rdd+=da
    return np.array(T),np.array(U),np.array(Q)
def moves(g,fs,L,vm,am,T,dwell):
    x=0.;mv=[];tt=0.
    while tt<T:
        y=g.uniform(-L/2,L/2)
        if abs(y-x)<.2*L: continue
        v=vm*10**g.uniform(-.9,0); a=am*10**g.uniform(-.5,0)
        d=abs(y-x)/v+v/a
        if d>T/3: continue
        tt+=d+dwell; mv.append((y-x,v,a,dwell)); x=y
    return ptp(fs,mv,.3*vm/am)
UN=[('N','m'),('kN','m'),('mN','um'),('N','mm'),('lbf','in'),('Nm','rad'),('Nm','deg'),('mNm','deg'),('A','mm'),('mA','deg'),('A','turns'),('V','rad')]
FS={'N':1,'kN':1e-3,'mN':1e3,'lbf':1/4.4482216,'Nm':1,'mNm':1e3,'A':1,'mA':1e3,'V':1}
QS={'m':1,'um':1e6,'mm':1e3,'in':1/.0254,'rad':1,'deg':180/math.pi,'turns':1/(2*math.pi)}
def mk(i,effs):
    g=np.random.default_rng(90000+i+1000*C.SEED); nm='r%02d_'%i+('null' if not effs else '_'.join(e.split('.')[-1] for e in effs))
    rot='gantry.gravity' in effs
    un=[x for x in UN if (x[1] in('rad','deg','turns'))==rot or not rot]; uu,qu=un[g.integers(len(un))]
    isrot=qu in('rad','deg','turns')
    fs=int(g.choice([100,125,200,250,400,500,1000])); tau=10**g.uniform(-.3,.35)   # span time at top speed .5 to 2.2 s
    if fs<=125: tau=max(tau,1.)
    L=g.uniform(1.3,3.) if rot else (10**g.uniform(-.2,1.5) if isrot else 10**g.uniform(-2.3,1.))
    vm=L/tau; am=vm/(tau*g.uniform(.15,.4)); M=10**g.uniform(-4,-1) if isrot else 10**g.uniform(-1.,3.5)
    F=M*am*.6; Fc=g.uniform(.08,.6)*F; Fv=g.uniform(.1,.6)*F/vm; F0=g.uniform(-.5,.5)*F*(not rot)
    wn=min(12./tau*2,fs*.25); kp=M*wn*wn; kd=1.4*M*wn
    P=dict(fs=fs,M=M,Fc=Fc,Fv=Fv,F0=F0,L=L,vm=vm,am=am,F=F); ex=[];fr=[];kw=dict(); drv=[]
    T=g.uniform(11,16)*max(1,tau/1.2); sub=max(10,int(math.ceil(5000/fs))); h=L/2
    dtk=1/fs
    for e in effs:
        s=g.uniform(.3,.9)
        if e=='gantry.stiffness': k=s*F/h; ex.append(lambda q,v,t,k=k:-k*q); P['k']=k
        elif e=='gantry.gravity': A=s*2*F;ph=g.uniform(-.8,.8); ex.append(lambda q,v,t,A=A,ph=ph:-A*math.cos(q+ph)); P['A']=A
        elif e=='drive.ripple.motor': A=s*.4*F;p=L/g.uniform(4,12); ex.append(lambda q,v,t,A=A,p=p:A*math.sin(2*math.pi*q/p+1)); P['A']=A;P['p']=p
        elif e=='gantry.endstop':
            hi,lo=g.uniform(.36,.44)*L,-g.uniform(.36,.44)*L; k=g.uniform(20,80)*F/L; ex.append(lambda q,v,t,k=k,hi=hi,lo=lo:-k*(q-hi) if q>hi else -k*(q-lo) if q<lo else 0.); P.update(k=k,hi=hi,lo=lo)
        elif e=='drive.friction.quadratic': c=s*F/vm**2; ex.append(lambda q,v,t,c=c:-c*v*abs(v)); P['c']=c
        elif e=='drive.friction.asymmetric': d=s*F/vm*.8; Fv=max(Fv,d); P['Fv']=Fv; ex.append(lambda q,v,t,d=d:-.5*d*abs(v)); P['dv']=d
        elif e=='drive.friction.load': K=g.uniform(.08,.22); fr.append(lambda q,v,t,f,K=K:K*abs(f)); P['K']=K
        elif e=='drive.friction.position': Fc=max(Fc,.3*F); P['Fc']=Fc; c=g.uniform(.5,.9)*Fc/h; fr.append(lambda q,v,t,f,c=c:c*q); P['slope']=c
        elif e=='drive.friction.stribeck': Fc=max(Fc,.25*F);P['Fc']=Fc; A=g.uniform(.4,.9)*Fc; vs=g.uniform(.06,.15)*vm; fr.append(lambda q,v,t,f,A=A,vs=vs:A*math.exp(-abs(v)/vs)); P.update(Fs=A,vs=vs)
        elif e=='drive.friction.presliding': A=g.uniform(.3,.6)*F; d=L*10**g.uniform(-2.7,-2.2); kw['dahl']=(A,d); Fc=0.; P.update(Fc=0,Fb=A,d=d)
        elif e=='gantry.mass_position': m=g.uniform(.4,.7)*M/h; kw['dmdq']=m; P['m1']=m
        elif e=='drive.friction.thermal_drift': Fc=max(Fc,.4*F);P['Fc']=Fc; A=g.uniform(.4,.6)*Fc; Tt=T*g.uniform(.4,.8); fr.append(lambda q,v,t,f,A=A,Tt=Tt:-A*(1-math.exp(-t/Tt))); P.update(dc=-A,T=Tt)
        elif e in('drive.delay','drive.lag1'):
            Td=g.uniform(3,7)*max(dtk,.004*tau)
            P['Td']=Td
            if e=='drive.delay':
                def dr(u,v,t,z,dt,Td=Td):
                    b=z[3] or [0.]*round(Td/dt); b.append(u); z[3]=b; return b.pop(0)
            else:
                def dr(u,v,t,z,dt,Td=Td): z[2]+=dt*(u-z[2])/Td; return z[2]
            drv.append(dr); wn2=min(wn,.35/Td); kp=M*wn2*wn2; kd=1.4*M*wn2
        elif e=='drive.saturation.speed':
            lim=g.uniform(.55,.8)*(M*am+Fc+Fv*vm)*.8; drv.append(lambda u,v,t,z,dt,lim=lim:max(-lim,min(lim,u))); P['lim']=lim
        elif e=='drive.compliance.belt':
            f=fs/40*g.uniform(.35,.8); r=g.uniform(.3,.7); P.update(f=f,r=r); kw['load_']=(r*M,f,.04)
    sh=g.uniform(0,1)
    def gen(s,r):
        gg=np.random.default_rng(500000+i*10+2*s+r+10000*C.SEED); ref=moves(gg,fs,L,vm,am,T,.25*tau)
        if 'drive.compliance.belt' in effs:
            f=P['f']; n=len(ref[0]); t=np.arange(n)/fs; c=[(vm/(2*math.pi*ff)*.12,ff,gg.uniform(0,6.28)) for ff in (.4*f,.7*f,1.05*f,1.4*f,1.9*f)]
            x=sum(a*np.sin(2*np.pi*ff*t+p) for a,ff,p in c); w=np.clip(np.minimum(t,t[-1]-t)/.5,0,1); x=x*w; ref=(ref[0]+x,ref[1]+np.gradient(x)*fs,ref[2]+np.gradient(np.gradient(x)*fs)*fs)
        k=dict(kw); l=k.pop('load_',None); MM=M
        if l: k['load']=mkload(*l); MM=M-l[0]
        if ex: k['extra']=(lambda q,v,t:sum(e(q,v,t) for e in ex)) if len(ex)>1 else ex[0]
        if fr: k['fric']=(lambda q,v,t,f:sum(e(q,v,t,f) for e in fr)) if len(fr)>1 else fr[0]
        if drv: k['drive']=drv[0] if len(drv)==1 else (lambda u,v,t,z,dt:drv[1](drv[0](u,v,t,z,dt),v,t,z,dt))
        return faxis(fs,sub,ref,MM,Fc,Fv,F0,kp,kd,t0=r*(T*1.4),**k)
    su=FS[uu]; sq=QS[qu]
    syn={'drive.delay':'drive.lag1/current_loop','drive.lag1':'drive.delay/current_loop','drive.saturation.speed':'drive.saturation.torque_speed','gantry.gravity':'drive.ripple.motor as indistinguishable'}
    out(nm,'null' if not effs else 'single' if len(effs)==1 else 'double','u',uu,su,g.uniform(.004,.02)*F*su,'q',qu,sq,L*sq*2**-g.uniform(13.5,16),L*sq*2**-g.uniform(12.5,15),effs,[syn[e] for e in effs if e in syn],gen,params={k:float(v) for k,v in P.items()})
def mkv(i,effs):
    g=np.random.default_rng(70000+i+1000*C.SEED); nm='v%02d_'%i+('null' if not effs else '_'.join(e.split('.')[-1] for e in effs))
    uu,qu,su,sq=[('m/s','m',1,1),('mm/s','mm',1e3,1e3),('m/min','m',60,1),('rad/s','rad',1,1),('rpm','deg',60/(2*math.pi),180/math.pi),('deg/s','deg',180/math.pi,180/math.pi)][g.integers(6)]
    fs=int(g.choice([50,100,200,250])); a=10**g.uniform(-1.5,1.); T=g.uniform(3,12)/fs*2; rho=g.choice([0.,.3/T*g.uniform(.3,1)]); Fc=g.uniform(.01,.06)*a; Fv=g.uniform(.02,.2); 
    P=dict(fs=fs,a=a,T=T,rho=rho,Fc=Fc,Fv=Fv); pre=[]; F0=0.
    for e in effs:
        if e=='drive.delay': Td=g.uniform(3,9)/fs; P['Td']=Td; pre.append(('d',Td))
        if e=='drive.lag1': Td=g.uniform(8,20)/fs; P['lag']=Td; pre.append(('l',Td))
        if e=='drive.saturation.slew': S=a/T*g.uniform(.12,.3); P['S']=S; pre.append(('s',S))
        if e=='drive.saturation.speed': S=a*g.uniform(.55,.75); P['lim']=S; pre.append(('v',S))
        if e=='drive.input_deadband': S=a*g.uniform(.06,.14); lo=float(g.choice([0,1])); P['u0']=S;P['lost']=lo; pre.append(('b',S,lo))
    def gen(s,r):
        gg=np.random.default_rng(600000+i*10+2*s+r+10000*C.SEED); seq=[(0,.4)];t=0
        while t<14: 
            d=gg.uniform(.8,2.2); seq.append((gg.choice([-1,1])*a*10**gg.uniform(-1,0),d)); t+=d
        f1=min(.12/T,fs/30)
        S=np.concatenate([steps(fs,seq,gg.choice([.05,.2])),chirp(fs,6,.1,f1,.45*a),steps(fs,[(a,1.5),(-a,1.5),(0,.5)],.1)])
        fl=[]
        for p in pre:
            fl.append({'d':lambda p:delaypre(p[1]),'l':lambda p:lagpre3(p[1]),'s':lambda p:slewpre(p[1]),'v':lambda p:(lambda w,t,z,dt:max(-p[1],min(p[1],w))),'b':lambda p:(lambda w,t,z,dt:0. if abs(w)<p[1] else w-p[2]*p[1]*sg(w))}[p[0]](p))
        pf=None if not fl else fl[0] if len(fl)==1 else (lambda w,t,z,dt:fl[1](fl[0](w,t,z,dt),t,z,dt))
        return velocity_axis(fs,max(10,2000//fs),S,T,1.,rho,Fc,Fv,F0,pre=pf)
    syn={'drive.delay':'drive.lag1','drive.lag1':'drive.delay'}
    out(nm,'null' if not effs else 'single' if len(effs)==1 else 'double','v_set',uu,su,0.,'q',qu,sq,a*sq*T*.002,a*sq*T*.004,effs,[syn[e] for e in effs if e in syn],gen,params={k:float(v) for k,v in P.items()})
S=['gantry.stiffness','gantry.gravity','drive.ripple.motor','gantry.endstop','drive.friction.quadratic','drive.friction.asymmetric','drive.friction.load','drive.friction.position','drive.friction.stribeck','drive.friction.presliding','gantry.mass_position','drive.friction.thermal_drift','drive.delay','drive.lag1','drive.saturation.speed','drive.compliance.belt']
i=0
for rep in range(2):
    for e in S: mk(i,[e]); i+=1
for k in range(12): mk(i,[]); i+=1
for p in [(0,8),(3,0),(2,9),(4,7),(5,12),(1,6),(3,11),(10,0),(14,4),(13,2),(9,0),(8,3)]: mk(i,[S[p[0]],S[p[1]]]); i+=1
V=['drive.delay','drive.lag1','drive.saturation.slew','drive.saturation.speed','drive.input_deadband']
j=0
for rep in range(2):
    for e in V: mkv(j,[e]); j+=1
for k in range(5): mkv(j,[]); j+=1
for p in [(0,2),(0,4),(1,3),(3,0),(2,4)]: mkv(j,[V[p[0]],V[p[1]]]); j+=1
MYCASES=dict(CASES)
if __name__=='__main__':
    import time
    saved=dict(CASES)
    for n in list(sys.argv[1:] or saved):
        a=time.time(); 
        try: C.build(n)
        except Exception as ex: print(n,'FAILED',repr(ex)); continue
        if time.time()-a>4: print(n,round(time.time()-a,1),flush=True)
