import ctypes,numpy as np,sys,os,json
sys.path.insert(0,'pb')
import klasktron_pb2 as K
from mcap.writer import Writer, CompressionType
from mkparams import NAMES
lib=ctypes.CDLL('./sim.so')
D=ctypes.POINTER(ctypes.c_double)
def ptr(a): return a.ctypes.data_as(D)
FDS=open('../../datasets_schema/klasktron.fds','rb').read()
XL=(-0.125,0.125); YL=(-0.185,-0.035)
XC,YC=0.0,-0.11

class Course:
    """velocity/position reference on the command grid"""
    def __init__(s,rate,rng,speed=1.0):
        s.h=1/rate; s.rng=rng; s.p=[np.array([XC,YC])]; s.v=[np.zeros(2)]; s.marks=[]; s.speed=speed; s.run=0
    def push(s,v):
        s.v.append(np.array(v)); s.p.append(s.p[-1]+s.h*s.v[-1])
    def rest(s,T):
        for _ in range(int(T/s.h)): s.push((0,0))
    def goto(s,target,vmax,acc):
        target=np.array(target); d=target-s.p[-1]; L=np.hypot(*d)
        if L<1e-5: return
        u=d/L; vm=min(vmax,np.sqrt(L*acc)); T=L/vm+vm/acc; n=max(2,int(np.ceil(T/s.h))); st=s.p[-1]
        def pos(t):
            t=np.clip(t,0,T); ta=vm/acc
            return np.where(t<ta,.5*acc*t*t,np.where(t<T-ta,.5*acc*ta*ta+vm*(t-ta),L-.5*acc*(T-t)**2))
        ts=np.arange(0,n+1)*T/n; P=pos(ts)
        # time-scaled by rounding to whole samples
        for i in range(n): s.push(u*(P[i+1]-P[i])/s.h)
    def start(s,pat): s.run+=1; s.marks.append((len(s.p),s.run,pat,0))
    def end(s): s.rest(0.12); s.marks.append((len(s.p),s.run,None,1)); s.rest(0.15)
    def bounce(s,a,b,vs,acc,T):
        n0=len(s.p); k=0
        while (len(s.p)-n0)*s.h<T:
            v=vs[k%len(vs)]; s.goto(b if k%2==0 else a,v,acc); k+=1
    def pattern(s,name,T):
        r=s.rng; sp=s.speed
        c=np.array([XC,YC]); 
        if name=='circle':
            R=r.uniform(.045,.07); v=r.uniform(.2,.4)*sp; cc=np.array([XC+r.uniform(-.05,.05),YC]); ph=r.uniform(0,6.28); sg=r.choice([-1,1])
            s.goto(cc+R*np.array([np.cos(ph),np.sin(ph)]),.25,2); s.rest(.2); s.start(name); n=int(T/s.h); p0=s.p[-1].copy(); th=ph; 
            for i in range(n):
                w=min(1,(i*s.h)/.4); 
                if i>n-20: w=(n-i)/20
                # reverse half way
                s2=sg if i<n/2 else -sg
                wr=min(1,abs(i-n/2)/10); th+=s2*v*w*wr/R*s.h
                q=cc+R*np.array([np.cos(th),np.sin(th)]); s.push((q-s.p[-1])/s.h)
        elif name in('x_line','y_line','diagonal_up','diagonal_down'):
            a,b={'x_line':((-.11,YC),(.11,YC)),'y_line':((0,-.18),(0,-.04)),'diagonal_up':((-.07,-.175),(.07,-.045)),'diagonal_down':((-.07,-.045),(.07,-.175))}[name]
            a=np.array(a)+r.uniform(-.008,.008,2);b=np.array(b)+r.uniform(-.008,.008,2)
            s.goto(a,.25,2); s.rest(.2); s.start(name); v=r.uniform(.1,.4,5)*sp; s.bounce(a,b,np.maximum(v,.05),r.uniform(2.5,7),T)
        elif name=='ramp':
            a=np.array((-.09,-.15))+r.uniform(-.02,.02,2);b=np.array((.09,-.07))+r.uniform(-.02,.02,2)
            s.goto(a,.25,2); s.rest(.2); s.start(name); s.bounce(a,b,np.array([.08,.12,.18,.24,.3,.36,.42])*sp,5,T)
        elif name=='waypoints':
            s.start(name); n0=len(s.p)
            while (len(s.p)-n0)*s.h<T:
                s.goto((r.uniform(*XL),r.uniform(*YL)),r.uniform(.08,.42)*sp,r.uniform(2,7)); s.rest(r.choice([0,0,.1,.25]))
        elif name=='creep':
            s.goto(c+r.uniform(-.05,.05,2),.25,2); s.rest(.2); s.start(name); n0=len(s.p)
            while (len(s.p)-n0)*s.h<T:
                ang=r.uniform(0,6.28); L=r.uniform(.004,.02); q=np.clip(s.p[-1]+L*np.array([np.cos(ang),np.sin(ang)]),(XL[0],YL[0]),(XL[1],YL[1])); s.goto(q,r.uniform(.008,.05),2)
        elif name=='steps':
            s.goto(c,.25,2); s.rest(.2); s.start(name); n0=len(s.p); 
            while (len(s.p)-n0)*s.h<T:
                ax=r.integers(3); v=r.uniform(.1,.38)*sp*r.choice([-1,1]); d=np.array([(1,0),(0,1),(.7,.7)][ax])*v; m=int(r.uniform(.1,.3)/s.h)
                q=s.p[-1]+d*m*s.h
                if not(XL[0]<q[0]<XL[1] and YL[0]<q[1]<YL[1]): d=-d; q=s.p[-1]+d*m*s.h
                if not(XL[0]<q[0]<XL[1] and YL[0]<q[1]<YL[1]): s.goto(c,.3,4); continue
                for _ in range(m): s.push(d)
                s.rest(r.uniform(.08,.25))
        elif name=='chirp':
            s.goto(c,.25,2); s.rest(.2); s.start(name); n=int(T/s.h); ang=r.uniform(0,3.14); u=np.array([np.cos(ang),np.sin(ang)]); ph=0; p0=s.p[-1].copy()
            u2=np.array([-u[1],u[0]])
            for i in range(n):
                f=.8*(9/.8)**(i/n); ph+=2*np.pi*f*s.h; A=min(.3*sp,.05*2*np.pi*f, 6.0/(2*np.pi*f))
                uu=u if i<n*0.999 else u2; s.push(A*np.cos(ph)*uu)
            s.goto(p0,.2,3)
        s.end()

def course(rate,seed,speed,T=50):
    rng=np.random.default_rng(seed); C=Course(rate,rng,speed); C.rest(.6)
    pats=['circle','waypoints','diagonal_up','creep','ramp','steps','diagonal_down','chirp','x_line','y_line','waypoints','circle']
    head=pats[:1]; rest=pats[1:]; rng.shuffle(rest); pats=head+rest
    n=0
    while len(C.p)*C.h<T-3.6: C.pattern(pats[n%len(pats)],min(rng.uniform(3,4.6),T-1-len(C.p)*C.h)); n+=1
    C.rest(.4); return C

def msg(schema,**k): return getattr(K,schema)(**k)

def record(path,P,cam,seed,courseseed,speed,session,meas):
    """P: params dict; cam: camera dict; meas: message rates"""
    rng=np.random.default_rng(seed)
    C=course(meas['cmd_hz'],courseseed,speed); n=len(C.p); h=C.h
    T=n*h+.3
    tc=np.arange(n)*h+.05+np.abs(rng.normal(0,.00015,n)); tc=np.sort(tc)
    p=np.array(C.p);v=np.vstack([np.array(C.v)[1:],np.zeros((1,2))])
    a=lambda z:np.ascontiguousarray(z,dtype=float)
    par=a([P[k] for k in NAMES]); rx,ry,rvx,rvy=a(p[:,0]),a(p[:,1]),a(v[:,0]),a(v[:,1])
    cx=np.zeros(n);cy=np.zeros(n)
    ne=int(T*meas['enc_hz'])-1
    te=np.arange(ne)/meas['enc_hz']*(1+meas['enc_ppm']*1e-6)+.002; teb=te+.0005
    ea=np.zeros((ne,4));eb=np.zeros((ne,4))
    nk=int(T*120)-3; tk=np.arange(nk)/meas['cam_hz']+.004
    cm=np.zeros((nk,4)); st=np.zeros(8)
    r=lib.sim(ptr(par),ctypes.c_double(T),ctypes.c_double(XC),ctypes.c_double(YC),n,ptr(a(tc)),ptr(rx),ptr(ry),ptr(rvx),ptr(rvy),ctypes.c_double(.00044),ctypes.c_double(.00089),ptr(cx),ptr(cy),ne,ptr(a(te)),ptr(a(teb)),ptr(ea),ptr(eb),nk,ptr(tk),ptr(cm),ptr(st))
    assert r==0
    # ---- sensors
    jit=lambda m:np.maximum(0,.0003+rng.normal(0,.0002,m))
    la=te+jit(ne); lb=np.maximum(teb+jit(ne),la+.0001)
    T0=1_795_000_000_000_000_000+int(seed)*1_000_000_000_000
    ns=lambda t:T0+int(round(t*1e9))
    out=[]
    f=open(path,'wb'); w=Writer(f,compression=CompressionType.ZSTD); w.start(profile='klasktron',library='table4 generator')
    meta=dict(schema_version='1',source='hardware',session=session,robot=meas['robot'],belt_metres_per_turn='0.04',command_arrival_left_a_s='0.00044',command_arrival_left_b_s='0.00089')
    w.add_metadata('klasktron.recording',meta)
    ch={}
    def chan(topic,schema):
        sid=ch.get('s'+schema)
        if sid is None: sid=w.register_schema('klasktron.'+schema,'protobuf',FDS); ch['s'+schema]=sid
        ch[topic]=w.register_channel(topic,'protobuf',sid)
    for t,s in (('/striker/left/command','VelocityCommand'),('/striker/left/carriage','CarriageState'),('/motor/left/a','MotorState'),('/motor/left/b','MotorState'),('/drive/left/a','DriveStatus'),('/drive/left/b','DriveStatus'),('/camera/detections','CameraDetections'),('/run/marker','RunMarker')): chan(t,s)
    ev=[]
    for i in range(n): ev.append((tc[i],tc[i],'/striker/left/command',K.VelocityCommand(vx=cx[i],vy=cy[i])))
    B=.04; tn=meas['torque_noise']
    na=rng.normal(0,tn,(ne,2))
    for i in range(ne):
        A=ea[i];Bb=eb[i]
        ev.append((la[i],la[i],'/motor/left/a',K.MotorState(position_turns=float(np.float32(A[0]/B)),velocity_turns_per_s=float(np.float32(A[1]/B)),torque_target_nm=A[2],torque_estimate_nm=A[3]+na[i,0])))
        ev.append((lb[i],lb[i],'/motor/left/b',K.MotorState(position_turns=float(np.float32(Bb[0]/B)),velocity_turns_per_s=float(np.float32(Bb[1]/B)),torque_target_nm=Bb[2],torque_estimate_nm=Bb[3]+na[i,1])))
        ev.append((lb[i]+1e-6,lb[i]+1e-6,'/striker/left/carriage',K.CarriageState(x=(A[0]+Bb[0])/2,y=(A[0]-Bb[0])/2,vx=(A[1]+Bb[1])/2,vy=(A[1]-Bb[1])/2)))
    for i in range(int(T*10)-1):
        for m in 'ab': ev.append((i*.1+.003,i*.1+.003,'/drive/left/'+m,K.DriveStatus(axis_state=8,bus_voltage_v=24.0+.02*rng.normal(),motor_temperature_c=30.,fet_temperature_c=33.)))
    # camera
    s,th,sq=cam['scale'],cam['rot'],cam['square']
    X=cm[:,0]+cm[:,1]*np.tan(sq); Y=cm[:,1]
    cX=s*(np.cos(th)*X-np.sin(th)*Y)+cam['ox']; cY=s*(np.sin(th)*X+np.cos(th)*Y)+cam['oy']
    r2=cX**2+cY**2; kd=1+cam['k1']*r2; cX*=kd; cY*=kd
    nz=rng.normal(0,cam['noise'],(nk,2)); keep=rng.uniform(size=nk)>cam['drop']
    arr=tk+.018+np.abs(rng.normal(0,.001,nk)); stamp=tk*(1+cam['skew'])+cam['lat']+rng.normal(0,cam['stampjit'],nk)
    for i in range(nk):
        if keep[i]: ev.append((max(arr[i],stamp[i]+.001),stamp[i],'/camera/detections',K.CameraDetections(capture_time_ns=ns(stamp[i]),left=K.Point(x=cX[i]+nz[i,0],y=cY[i]+nz[i,1]))))
    last=None
    for idx,run,pat,ph in C.marks:
        if ph==0: last=pat
        t=tc[min(idx,n-1)]-.001
        ev.append((t,t,'/run/marker',K.RunMarker(run=run,pattern=pat or last,phase=ph)))
    ev.sort(key=lambda e:e[0])
    for q,(t,tp,topic,m) in enumerate(ev): w.add_message(ch[topic],ns(t),m.SerializeToString(),ns(tp),q)
    w.finish(); f.close()
    return dict(maxd_mm=st[0]*1e3,vmax=st[1],Fmax=st[2],x=(st[3],st[4]),y=(st[5],st[6]),T=T)
