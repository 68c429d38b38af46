#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <math.h>
#include <stdint.h>
static int AC; static char**AV;
static double G(const char*k,double d){size_t n=strlen(k);double r=d;for(int i=1;i<AC;i++)if(!strncmp(AV[i],k,n)&&AV[i][n]=='=')r=atof(AV[i]+n+1);return r;}
static uint64_t S;
static double U(void){S^=S<<13;S^=S>>7;S^=S<<17;return (S>>11)*(1.0/9007199254740992.0);}
static double N(void){double a=U()+1e-300,b=U();return sqrt(-2*log(a))*cos(2*M_PI*b);}
#define sg(x) (((x)>0)-((x)<0))
/* course: value and derivative */
static int ctype; static double amp,spd,acc,f0,f1,hold;
static int nh; static double hf[40],ha[40],hp[40];
static double cp,cv; /* trap state */ static double p0,dist_,vm,ta,tt0,rest;
static double lastsw,lvl,rw,rwt,rwv; static int lad; static double T;
static void course(double t,double dt,double*r,double*rd){
  *r=0;*rd=0;
  if(ctype==1){ /* trapezoids */
    double tau=t-tt0; double D=fabs(dist_),s=sg(dist_); double tot=D>0?D/vm+ta:0;
    if(tau>=tot+rest){ p0+=dist_; tt0=t; double target=(2*U()-1)*amp; if(U()<0.3) target=p0+0.1*amp*(2*U()-1); if(fabs(target)>amp)target=amp*sg(target);
      dist_=target-p0; D=fabs(dist_); s=sg(dist_); double v=spd*(0.08+0.92*U()*U()*1.0); if(U()<0.35) v=spd*(0.6+0.4*U()); if(v*v/acc>D) v=sqrt(D*acc); if(v<1e-12)v=1e-12; vm=v; ta=v/acc; rest=hold*(0.2+U()); tau=0; tot=D/vm+ta; }
    double q,qd; if(tau<ta){q=0.5*acc*tau*tau;qd=acc*tau;} else if(tau<tot-ta){q=vm*(tau-ta/2);qd=vm;} else if(tau<tot){double l=tot-tau;q=D-0.5*acc*l*l;qd=acc*l;} else {q=D;qd=0;}
    *r=p0+s*q;*rd=s*qd;
  } else if(ctype==2){ for(int i=0;i<nh;i++){double w=2*M_PI*hf[i];*r+=ha[i]*sin(w*t+hp[i]);*rd+=ha[i]*w*cos(w*t+hp[i]);} }
  else if(ctype==3){ double Tc=hold>0?hold:T; double tm=fmod(t,Tc); double k=log(f1/f0)/Tc; double ph=2*M_PI*f0*(exp(k*tm)-1)/k, w=2*M_PI*f0*exp(k*tm); double a=amp*pow(f0/(w/2/M_PI),spd); *r=a*sin(ph);*rd=a*w*cos(ph);}
  else if(ctype==4){ if(t-lastsw>=hold){ if(U()<0.5) lvl=-lvl; if(lvl==0)lvl=amp; lastsw=t; if(spd>0) lvl=sg(lvl)*amp*(1-spd*U()); } *r=lvl; }
  else if(ctype==5){ /* step ladder up/down both signs */ if(t-lastsw>=hold||lastsw<0){lastsw=t;lad++;} static const double L[]={0.25,0.5,0.75,1,0.6,0.3,0,-0.25,-0.5,-0.75,-1,-0.6,-0.3,0,1,-1,0.8,-0.8,0.4,-0.4,0.15,-0.15}; *r=amp*L[lad%22]; }
  else if(ctype==6){ /* smoothed random walk setpoint */ if(t-lastsw>=hold){lastsw=t;lvl=amp*(2*U()-1);} rwv+=dt*((lvl-rw)*f0*f0*39.48-2*0.8*f0*6.283*rwv); rw+=dt*rwv; *r=rw;*rd=rwv; }
}
int main(int argc,char**argv){AC=argc;AV=argv;
 S=(uint64_t)G("seed",1)*0x9E3779B97F4A7C15ull+12345; for(int i=0;i<20;i++)U();
 double fs=G("fs",1000),dt=1/fs;T=G("T",15); int sub=G("sub",20); double h=dt/sub;
 int mode=G("mode",0);
 double M=G("M",1)+G("dM",0),B=G("B",0),Fc=G("Fc",0),ke=G("ke",0),te=G("te",0),rho=G("rho",0),dM=G("dM",0);
 double dFc=G("dFc",0),dB=G("dB",0);
 double gA=G("gA",0),gB=G("gB",0),dgA=G("dgA",0),dgB=G("dgB",0),K=G("K",0),tilt=G("tilt",0),dtilt=G("dtilt",0),dK=G("dK",0);
 double rA=G("rA",0),rP=G("rP",1),rPh=G("rPh",0),drA=G("drA",0),drP=G("drP",1);
 double gain=G("gain",1),off=G("off",0),delay=G("delay",0),lag=G("lag",0),db=G("db",0),dbs=G("dbs",1),sat=G("sat",1e30),slew=G("slew",1e30),tsF=G("tsF",1e30),tsv=G("tsv",1e30);
 double bq=G("bq",0),adv=G("adv",0),adc=G("adc",0),Fs=G("Fs",0),vs=G("vs",1),sde=G("sde",1),Kl=G("Kl",0),pre=G("pre",0),pA=G("pA",0),pL=G("pL",1),pS=G("pS",0),th=G("th",0),thT=G("thT",10),thv=G("thv",0);
 double es=G("es",0),eh=G("eh",1e30),el=G("el",-1e30),m1=G("m1",0),m2=G("m2",0),lf=G("lf",0),cf=G("cf",50),cz=G("cz",0.03),gap=G("gap",0); int encl=G("encl",0);
 double ec=G("ec",0),ecP=G("ecP",1),lost=G("lost",0),lostn=G("lostn",0),jit=G("jit",0),sc=G("sc",1);
 double yq=G("yq",0),yn=G("yn",0),un=G("un",0),uq=G("uq",0),umax=G("umax",1e30),dis=G("dis",0),dit=G("dit",0),dcor=G("dcor",0.02);
 double Kp=G("Kp",0),Kd=G("Kd",0),tf=G("tf",0),Mff=G("Mff",0);int cl=G("cl",0);
 double ufac=G("ufac",1),yfac=G("yfac",1),q0=G("q0",0);
 ctype=G("c",1);amp=G("amp",1);spd=G("spd",0);acc=G("acc",1);f0=G("f0",0.5);f1=G("f1",10);hold=G("hold",0.3);
 nh=G("nh",12); for(int i=0;i<nh;i++){hf[i]=f0*pow(f1/f0,(i+0.6*U())/(nh-0.5));hp[i]=6.283*U();ha[i]=amp*sqrt(2.0/nh)*pow(f0/hf[i],spd);}
 double df[20],dp[20];for(int i=0;i<20;i++){df[i]=G("df0",1)*pow(G("df1",20)/G("df0",1),(i+U())/20.);dp[i]=6.283*U();}
 int RB=(int)(delay/h)+2; double*rb=calloc(RB,sizeof(double));int ri=0;
 lastsw=-1e9;lad=-1+(int)(22*U()); tt0=-1e9;
 double x=0,v=0,xl=0,vl=0,ul=0,uS=0,F=0,I=0,z=0,yp=0,ve=0,d=0,loff=0; double su=0,seff=0,sv=0,sa=0,xm=1e30,xM=-1e30,vmax=0; long n=0; double rdp=0;
 double ramp=G("ramp",0),cut=G("cut",0); int kick=G("kick",0);
 printf("%s\n","t,u,y");
 int ns=(int)(T*fs);
 for(int k=0;k<ns;k++){double t=k*dt;double r,rd;course(t,dt,&r,&rd); if(cl==1&&ramp>0&&t<ramp){double w=0.5-0.5*cos(M_PI*t/ramp),wd=0.5*M_PI/ramp*sin(M_PI*t/ramp); rd=rd*w+r*wd; r*=w;} if(k==0&&!kick)rdp=rd;
  double qe=encl?xl:x; if(lost>0&&U()<lost*dt)loff-=lostn; double y=sc*qe+loff+ec*sin(2*M_PI*qe/ecP)+yn*N(); if(yq>0)y=yq*floor(y/yq+0.5);
  double dd=0;if(dit!=0)for(int i=0;i<20;i++)dd+=dit*0.316*sin(2*M_PI*df[i]*t+dp[i]);
  double vm_=(y-yp)/dt; if(k==0)vm_=0; yp=y; ve+= (tf>0? dt/(dt+tf):1)*(vm_-ve);
  double u; if(cl==1){u=Kp*(r-y)+Kd*(rd-ve)+Mff*(rd-rdp)/dt+dd;} else if(cl==2){u=rd+Kp*(r-y)+dd;} else if(cl==3){u=r-Kp*y+dd;} else u=r+dd; rdp=rd;
  if(u>umax)u=umax;if(u<-umax)u=-umax; if(uq>0)u=uq*floor(u/uq+0.5);
  double ur=u+un*N(); double tr=t+jit*N(); if(t>=cut-1e-9)printf("%.7f,%.8g,%.10g\n",tr-cut,ur*ufac,(y+q0)*yfac);
  for(int j=0;j<sub;j++){
   rb[ri]=u; int rr=ri-(int)(delay/h+0.5); while(rr<0)rr+=RB; double ud=delay>0?rb[rr]:u; ri=(ri+1)%RB;
   if(lag>0)ul+=h/lag*(ud-ul);else ul=ud; double ue=ul;
   if(slew<1e29){double m=slew*h;uS+= ue-uS>m?m:(ue-uS<-m?-m:ue-uS);ue=uS;}
   if(db>0){ue=fabs(ue)<db?0:ue-dbs*db*sg(ue);} ue=gain*ue+off; if(fabs(ue)>sat)ue=sat*sg(ue);
   double Fd; if(mode==2){double e=ue-v;I+=h*rho*e;Fd=e+I;} else Fd=ue-ke*v;
   if(te>0)F+=h/te*(Fd-F);else F=Fd;
   double Fm=F; if(tsF<1e29){double lim=Fm*v>0?tsF*fmax(0,1-fabs(v)/tsv):tsF;if(fabs(Fm)>lim)Fm=lim*sg(Fm);}
   d+= -d*h/dcor + dis*sqrt(2*h/dcor)*(dis>0?N():0);
   double q=x; double ext=-gA*sin(q+q0)-gB*cos(q+q0)-K*q+tilt+rA*sin(2*M_PI*q/rP+rPh)+d;
   double ex=-dgA*sin(q+q0)-dgB*cos(q+q0)-dK*q+dtilt+drA*sin(2*M_PI*q/drP+1.1); if(es>0){if(q>eh)ex-=es*(q-eh);if(q<el)ex+=es*(el-q);}
   ex-=0.5*adv*v*fabs(v)/fmax(fabs(v),1e-12)*sg(v); double lx=dFc+0.5*adc*sg(v)+Fs*exp(-pow(fabs(v)/vs,sde))+Kl*fabs(Fm)+pA*sin(2*M_PI*q/pL)+pS*q+(th+thv*fabs(v))*(1-exp(-t/thT))+bq*v*v; 
   double L=Fc+lx; if(L<0)L=0;
   double Mq=M+m1*q+m2*q*q; double mom=-0.5*(m1+2*m2*q)*v*v;
   double Ms=Mq,fc=0;
   if(lf>0){Ms=Mq*(1-lf);double KK=Mq*lf*pow(6.2832*cf,2),CC=2*cz*6.2832*cf*Mq*lf;double dx=x-xl; if(gap>0){if(dx>gap/2)dx-=gap/2;else if(dx<-gap/2)dx+=gap/2;else dx=0;} fc=KK*dx+((gap>0&&dx==0)?0:CC*(v-vl)); }
   double vo=v;
   if(encl&&lf>0){ /* friction and externals on load */
     double fl=fc+ext+ex-(B+dB)*vl; double Ll=Fc+lx; double w=vl+h*fl/(Mq*lf); double im=h*Ll/(Mq*lf); vl=fabs(w)<=im?0:w-im*sg(w); v+=h*(Fm-fc)/Ms; xl+=h*vl; x+=h*v;
   } else {
     double Fn=Fm+ext+ex-(B+dB)*v+mom-fc;
     if(pre>0){double s0=L/pre,c=0.6*sqrt(s0*Ms); double dec=h*s0*fabs(v)/L; double zn=(z+h*v)/(1+dec);double zr=(zn-z)/h;z=zn; v+=h*(Fn-s0*z-c*zr)/Ms;}
     else {double w=v+h*Fn/Ms,im=h*L/Ms; v=fabs(w)<=im?0:w-im*sg(w);}
     x+=h*v; if(lf>0){vl+=h*fc/(Mq*lf);xl+=h*vl;}
   }
   double a=(v-vo)/h; double ef=(u-ue)+ex-lx*sg(v)-dB*v-dM*a-(Mq-M)*a; if(fabs(ef)<1e20){seff+=ef*ef;} su+=u*u;sv+=v*v;sa+=a*a;n++;
   if(fabs(v)>vmax)vmax=fabs(v);
  }
  if(x<xm)xm=x;if(x>xM)xM=x; if(!(fabs(x)<1e9)){fprintf(stderr,"DIVERGED\n");return 1;}
 }
 fprintf(stderr,"u_rms=%.4g eff/u=%.3f v_rms=%.4g vmax=%.4g a_rms=%.4g x=[%.4g,%.4g] Fc/u=%.3f\n",sqrt(su/n),sqrt(seff/su),sqrt(sv/n),vmax,sqrt(sa/n),xm,xM,Fc/sqrt(su/n));
 return 0;}
